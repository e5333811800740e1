"""Whether anything is left to search: a frontier of the merged map to which a path leads from the MS.

Looking at the whole map at every tick would cost more than all else that the MS does. So the MS keeps one frontier in
mind, the farthest, and looks again only when that one is none any more, and not at once.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import _floor
from agents.own_map import frontiers
from agents.planner import reach_over
from world.grid import FREE, GridGeometry

_LOOK_TICKS: Final = 100
"""Shortest time between two looks at the whole map."""
_EXHAUSTED_TICKS: Final = 300
"""A search without a frontier for so long is exhausted: scan reports of all robots that have a path have arrived."""


class Exhaustion:
    """Watches the merged map of one MS."""

    def __init__(self, geometry: GridGeometry, station_m: tuple[float, float]) -> None:
        self._geometry = geometry
        self._station = geometry.index(*station_m)
        self._frontier = -1
        """A cell that was a frontier at the last look; -1 without one."""
        self._looked_tick = -_LOOK_TICKS
        self._none_since: int | None = None

    def step(self, tick: int, states: NDArray[np.int8]) -> bool:
        """Whether the search is exhausted at a tick, by the states of all cells (size,)."""
        if self._frontier >= 0 and _floor.is_frontier(states, self._geometry.cols, self._frontier):
            return False
        if tick - self._looked_tick >= _LOOK_TICKS:
            self._looked_tick = tick
            found, lengths_m = self.reachable(states)
            self._frontier = int(found[np.argmax(lengths_m)]) if found.size else -1
            if self._frontier >= 0:
                self._none_since = None
            elif self._none_since is None:
                self._none_since = tick
        return self._none_since is not None and tick - self._none_since >= _EXHAUSTED_TICKS

    def reachable(self, states: NDArray[np.int8]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """All frontiers to which a path leads from the MS, and its length in metres."""
        cells = frontiers(states, self._geometry)
        if not cells.size or states[self._station] != FREE:
            return cells[:0], np.zeros(0)
        lengths_m = reach_over(states, self._geometry, self._station).lengths_m(cells)
        reached = lengths_m < math.inf
        return cells[reached], lengths_m[reached]
