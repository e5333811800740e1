"""The packages behind `vds`, and whether those that Python would import are ours.

They have names that people have in their own projects, too. Nothing here imports one of them.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Final

__all__ = ["HOME", "PACKAGES", "ShadowedError", "require_ours"]

PACKAGES: Final = ("bus", "world", "medium", "agents", "monitor_station", "deploy")
HOME: Final = Path(__file__).resolve().parent.parent
"""The checkout, or the folder of installed packages."""


class ShadowedError(ImportError):
    """A package of the user's stands where Python looks for ours. The message is one line."""


def require_ours() -> None:
    """Return if every package that is imported, or would be, is ours.

    Raises:
        ShadowedError: one is not.
    """
    for name in PACKAGES:
        loaded = sys.modules.get(name)
        place = _place(importlib.util.find_spec(name) if loaded is None else loaded.__spec__)
        if place is not None and place != HOME / name:
            where = place.parent
            raise ShadowedError(
                f"{place} hides the package `{name}` of the VDS emulator: rename it, or start Python so that {where} "
                "is not on its path, where PYTHONPATH, a script's own folder or the working folder puts it"
            )


def _place(spec: ModuleSpec | None) -> Path | None:
    """The folder of a package, or the file of a module; None of what is nowhere."""
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).resolve()
    return None if spec.origin is None else Path(spec.origin).resolve()
