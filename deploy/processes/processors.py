"""Which processor each process of a run stays on, when there are more processes than processors.

A tick is a chain of short turns, a few of which can run at a time, and a kernel that is busy wakes most processes on
the processor of who woke them, though another one idles (docs/performance.md has the numbers).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

__all__ = ["places", "shared"]


def shared(processes: int) -> tuple[int, ...]:
    """The processors that so many processes have to share; empty if there is one for each, or nobody can tell."""
    if sys.platform != "linux":
        return ()
    processors = tuple(sorted(os.sched_getaffinity(0)))
    return processors if processes > len(processors) else ()


def places(processors: Sequence[int], nodes: Sequence[str]) -> dict[str, int]:
    """The processor on which each process of a run stays: `medium`, `world`, and `nodes` in the order of their turns.

    The medium hands out the turns, so those go first whose processors are not the medium's.
    """
    if not processors:
        return {}
    last, share = len(processors) - 1, len(processors) / max(len(nodes), 1)
    stays = {node: processors[last - int(k * share)] for k, node in enumerate(nodes)}
    return stays | {"medium": processors[0], "world": processors[last]}
