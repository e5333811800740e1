"""One sortie of one robot: from the place where it left the network over the nearest frontiers, and back in time.

All times are reckoned with one mean speed, over the paths of the own map.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from agents.body import Body
from agents.planner import Reach
from world.terms import TICK_S, Place

_RENEW_TICKS: Final = 5
"""Shortest time between two looks whether the way home still fits."""


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
        at = self._body.planner.nearest_free(self._body.map.geometry.index(*self._body.at))
        return self._from_home().length_m(at) >= self._left_m()

    def next_frontier(self) -> tuple[Place, Reach] | None:
        """The nearest frontier from which the robot is home in time, and the search that led there."""
        body = self._body
        planner, g = body.planner, body.map.geometry
        cells = body.map.frontiers()
        if not cells.size:
            return None
        reach = planner.reach(planner.nearest_free(g.index(*body.at)))
        there_m = reach.lengths_m(cells)
        fits = np.flatnonzero(there_m + self._from_home().lengths_m(cells) < self._left_m())
        if not fits.size:
            return None
        nearest = int(fits[int(np.argmin(there_m[fits]))])
        return g.center(int(cells[nearest])), reach

    def _left_m(self) -> float:
        return (self.until - self._body.tick) * TICK_S * self._pace_m_s

    def _from_home(self) -> Reach:
        planner = self._body.planner
        return planner.reach(planner.nearest_free(self._body.map.geometry.index(*self.home)), max(self._left_m(), 0.0))
