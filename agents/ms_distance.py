"""How far places are from the MS along the own map (paper, II-A.3 rule 2)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from agents.own_map import OwnMap
from agents.planner import Planner, Reach

_RENEW_TICKS: Final = 50
"""Only the order of distances matters, and a robot needs longer than this for the margin of an MSR."""


class MsDistance:
    """Path lengths from the MS, searched anew when the map changed and somebody asks."""

    def __init__(self, own_map: OwnMap, planner: Planner, station_m: tuple[float, float]) -> None:
        self._map = own_map
        self._planner = planner
        self._station_m = station_m
        self._version = -1
        self._made_tick = -_RENEW_TICKS
        self._reach: Reach | None = None
        self.tick = 0
        """The present tick; set by the owner."""

    def __call__(self, x_m: float, y_m: float) -> float:
        """Path length in metres from the MS to a place.

        A place off the known free cells, as when the map lags behind its robot, counts from the nearest reached cell.
        """
        reach = self._renewed()
        g = self._map.geometry
        length = reach.length_m(g.index(x_m, y_m))
        if length < math.inf:
            return length
        cells, lengths = reach.reached()
        places = g.centers(cells)
        gaps = np.hypot(places[:, 0] - x_m, places[:, 1] - y_m)
        nearest = int(np.argmin(gaps))
        return float(lengths[nearest] + gaps[nearest])

    def _renewed(self) -> Reach:
        stale = self._version != self._map.version and self.tick - self._made_tick >= _RENEW_TICKS
        if self._reach is None or stale:
            g = self._map.geometry
            self._reach = self._planner.reach(self._planner.nearest_free(g.index(*self._station_m)))
            self._version, self._made_tick = self._map.version, self.tick
        return self._reach
