"""How often a process of a run looks for garbage that reference counts alone cannot free."""

from __future__ import annotations

import gc
from typing import Final

__all__ = ["collect_rarely"]

_OBJECTS: Final = 20_000
"""New objects between two looks; Python's own 700 cost a thirtieth of the time of a run."""


def collect_rarely() -> None:
    """What is there by now is never garbage, and what a tick makes is gone by itself: hardly look for cycles.

    To be called once everything is imported. It holds for the whole process, and spares forked ones copies of pages.
    """
    gc.freeze()
    gc.set_threshold(_OBJECTS)
