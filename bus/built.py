"""Compiled loops carry the digest of their source, so that none that is out of date is ever used.

A package's hot loops stand in `_NAME.pyx` files, their only form; each extension calls `check` as it is imported. An
installed package has no source beside the extension (pyproject.toml), so nothing could differ.
"""

from __future__ import annotations

import hashlib
import importlib
from pathlib import Path
from typing import Final

__all__ = ["INSTALLED", "LOOPS", "ROOT", "StaleLoopsError", "built_from", "check", "complaint", "digest"]

ROOT: Final = Path(__file__).resolve().parent.parent
INSTALLED: Final = any(ROOT.glob("vds_emulator-*.dist-info"))
"""Whether this is an installed package, neither a checkout nor a build of one."""
LOOPS: Final = (
    "agents._cells",
    "agents._floor",
    "agents._rows",
    "agents._search",
    "medium._receptions",
    "world._lidar",
    "world.grid._lines",
)
"""All files of compiled loops."""

_BUILT_FROM: Final[dict[str, str]] = {}
"""Digest of the source of all loops that this process has imported."""


class StaleLoopsError(ImportError):
    """Compiled loops that were built from another source than the one beside them."""


def digest(name: str) -> str:
    """SHA-256 of the source of the loops `name` (`package._name`) and of what it includes; empty if it is not there."""
    source = ROOT.joinpath(*name.split(".")).with_suffix(".pyx")
    if not source.exists():
        return ""
    return hashlib.sha256(source.read_bytes() + (ROOT / "bus" / "built.pxi").read_bytes()).hexdigest()


def check(name: str, source: str) -> None:
    """Accept the loops `name`, built from a source of that digest, if it is the source that is there.

    Raises:
        StaleLoopsError: they were not.
    """
    if digest(name) not in ("", source):
        raise StaleLoopsError(f"{name} is out of date: run `make setup` in {ROOT}")
    _BUILT_FROM[name] = source


def built_from() -> dict[str, str]:
    """By loops: the digest of the source that they were built from, in an installed package, too."""
    for name in LOOPS:
        importlib.import_module(name)
    return {name: _BUILT_FROM[name] for name in LOOPS}


def complaint() -> str:
    """What is wrong with the compiled loops, in one line; empty if all are there and up to date."""
    for name in LOOPS:
        try:
            importlib.import_module(name)
        except StaleLoopsError as error:
            return str(error)
        except ImportError:
            way = "install vds-emulator again" if INSTALLED else f"run `make setup` in {ROOT}"
            return f"{name} is not compiled: {way}"
    return ""
