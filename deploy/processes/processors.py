"""On which processor each process of a run stays if there are more processes than processors.

A tick is a chain of short turns, and few of them can run at a time. A busy kernel wakes most processes on the processor
of the process that woke them, though another processor is idle (numbers in docs/performance.md).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

__all__ = ["assigned", "shared"]


def shared(processes: int) -> tuple[int, ...]:
    """The processors that `processes` processes share; empty if each has one of its own, or if they are unknown."""
    if sys.platform != "linux":
        return ()
    processors = tuple(sorted(os.sched_getaffinity(0)))
    return processors if processes > len(processors) else ()


def assigned(processors: Sequence[int], nodes: Sequence[str]) -> dict[str, int]:
    """The processor on which each process of a run stays: `medium`, `world`, and `nodes` in the order of their turns.

    The medium hands out the turns, so the first nodes are on other processors than the medium.
    """
    if not processors:
        return {}
    last, share = len(processors) - 1, len(processors) / max(len(nodes), 1)
    stays = {node: processors[last - int(k * share)] for k, node in enumerate(nodes)}
    return stays | {"medium": processors[0], "world": processors[last]}
