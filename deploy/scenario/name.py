"""Names of scenarios and studies: each also names a folder, and must not lead out of the folder around it."""

from __future__ import annotations

from typing import Final

from bus.excerpt import shown
from deploy.scenario.tables import ScenarioError

__all__ = ["check_name", "name_of"]

_LONGEST: Final = 200
"""Bytes; a folder's name may have 255, and gets the time behind the scenario's name."""


def check_name(name: str) -> None:
    """Check that a name is a plain name of a folder.

    Raises:
        ScenarioError: it is not.
    """
    if not name.isprintable() or "/" in name or name.startswith((".", "-", " ")) or name.endswith(" ") or not name:
        what = "has no / and no control characters, and does not start with . or - or a space"
    elif len(name.encode()) > _LONGEST:
        what = f"has {_LONGEST} bytes at most"
    else:
        return
    raise ScenarioError(f"name = '{shown(name)}': it names a folder, so it {what}")


def name_of(stem: str) -> str:
    """A name after that of a file, which may have characters that a name may not."""
    plain = "".join("-" if c == "/" or not c.isprintable() else c for c in stem).strip(" ").lstrip(".- ")
    return plain.encode()[:_LONGEST].decode(errors="ignore") or "map"
