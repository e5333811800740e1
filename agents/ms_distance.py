"""How far places are from the MS along the own map [paper 4.4, 4.6]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from agents.own_map import OwnMap
from agents.planner import Planner, Reach

_RENEW_TICKS: Final = 50
"""Shortest time between two searches. Only the order of distances matters, and it changes slowly."""


class MsDistance:
    """Path lengths from the MS. A question starts a new search if the map has changed and the last search is old."""

    def __init__(self, own_map: OwnMap, planner: Planner, station_m: tuple[float, float]) -> None:
        self._map = own_map
        self._planner = planner
        self._station_m = station_m
        self._seen = 0
        """Mark of the map's changes that the search knows (`OwnMap.changes`)."""
        self._made_tick = -_RENEW_TICKS
        self._reach: Reach | None = None

    def lengths_m(self, tick: int, places_m: Sequence[tuple[float, float]]) -> list[float]:
        """Path lengths in metres from the MS to places.

        A place that is on no known free cell (the map lags behind its robot) counts from the nearest reached cell.
        """
        reach = self._renewed(tick)
        g = self._map.geometry
        lengths: list[float] = reach.lengths_m(np.array([g.index(x, y) for x, y in places_m], np.int64)).tolist()
        for k, (x, y) in enumerate(places_m):
            if lengths[k] == math.inf:
                lengths[k] = reach.length_near_m(x, y)
        return lengths

    def _renewed(self, tick: int) -> Reach:
        if self._reach is None or tick - self._made_tick >= _RENEW_TICKS:
            changed, seen = self._map.changes(self._seen)
            if self._reach is None or seen != self._seen:
                source = self._planner.nearest_free(self._map.geometry.index(*self._station_m))
                kept = self._reach
                if kept is None or kept.source != source or not kept.follow(self._map.cells, changed):
                    self._reach = self._planner.reach(source, around=False)
                self._seen, self._made_tick = seen, tick
        assert self._reach is not None
        return self._reach
