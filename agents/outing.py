"""One sortie of one robot: from the place where it left the network over the nearest frontiers, and back in time.

All times are reckoned with one mean speed, over the paths of the own map.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from agents.body import Body
from agents.planner import Reach
from world.terms import TICK_S, Place

_RENEW_TICKS: Final = 5
"""Shortest time between two looks whether the way home still fits."""
_LOOK_M: Final = 3.0
"""So far the next frontier is looked for at first."""


class Outing:
    """Where a robot left, and when it will be back."""

    def __init__(self, body: Body, budget_ticks: int, pace_m_s: float) -> None:
        """Begin where the robot is now."""
        self._body = body
        self._pace_m_s = pace_m_s
        self.home: Place = body.at
        self.until = body.tick + budget_ticks
        """When the robot is to be home again."""
        self.returning = False

    def turn_back(self) -> None:
        """Go home from now on; whoever turns back early is due early."""
        self.returning = True
        self.until = min(self.until, self._body.tick)

    def late(self) -> bool:
        """Whether the way home takes all of the time that is left. Not every tick is worth the search."""
        if self._body.tick % _RENEW_TICKS:
            return False
        planner, g, left_m = self._body.planner, self._body.map.geometry, self._left_m()
        at = planner.nearest_free(g.index(*self._body.at))
        return planner.length_m(self._home_cell(), at, max(left_m, 0.0)) >= left_m

    def next_frontier(self) -> tuple[Place, Reach] | None:
        """The nearest frontier from which the robot is home in time, and the search that led there."""
        body, left_m = self._body, self._left_m()
        planner, g = body.planner, body.map.geometry
        cells = body.map.frontiers()
        if not cells.size:
            return None
        source, from_home_m = planner.nearest_free(g.index(*body.at)), None
        if left_m <= 0.0:
            return None
        for limit_m in (min(_LOOK_M, left_m), left_m):
            reach = planner.reach(source, limit_m)
            there_m = reach.lengths_m(cells)
            if from_home_m is None and (there_m < math.inf).any():
                back_m = left_m - float(there_m.min()) + g.resolution_m
                from_home_m = planner.reach(self._home_cell(), back_m).lengths_m(cells)
            if from_home_m is None:
                continue
            fits = np.flatnonzero(there_m + from_home_m < left_m)
            if fits.size:
                nearest = int(fits[int(np.argmin(there_m[fits]))])
                return g.center(int(cells[nearest])), reach
        return None

    def _left_m(self) -> float:
        return (self.until - self._body.tick) * TICK_S * self._pace_m_s

    def _home_cell(self) -> int:
        return self._body.planner.nearest_free(self._body.map.geometry.index(*self.home))
