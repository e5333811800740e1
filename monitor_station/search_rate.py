"""Search rate and search time of each cell [paper 7.1], and the measures of the whole map against the truth.

Only what the map calls free counts as searched: that an area was looked at is no search if the map then shows a wall.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor_station.config import FINISHED, StationConfig
from world.grid import FREE, OCCUPIED
from world.terms import seconds_of

_SHARES: Final = {"t50_s": 0.5, "t90_s": 0.9, "t100_s": FINISHED}


class SearchRate:
    """Counts the cells of the grid that are known to be free, in each search cell and in all of them."""

    def __init__(self, config: StationConfig) -> None:
        search_cells, size = config.search_cells, config.node.geometry.size
        self.names = [c.name for c in search_cells]
        self.search_time_s: list[float | None] = [None] * len(search_cells)
        """When the rate of each search cell first was enough."""
        self.rates: tuple[float, ...] = (0.0,) * len(search_cells)
        self._enough = config.enough
        self._walls = config.occupied.ravel()
        self._sizes = [len(c.cells) for c in search_cells]
        self._found = [0] * len(search_cells)
        self._free: NDArray[np.bool_] = np.zeros(size, np.bool_)
        """The cells that are known to be free."""
        self._inside: NDArray[np.bool_] = np.zeros(size, np.bool_)
        self._layers: list[NDArray[np.int16]] = []
        """The search cell that holds each grid cell, or -1; those that overlap are in different layers."""
        for k, cell in enumerate(search_cells):
            self._inside[cell.cells] = True
            layer = next((layer for layer in self._layers if (layer[cell.cells] < 0).all()), None)
            if layer is None:
                layer = np.full(size, -1, np.int16)
                self._layers.append(layer)
            layer[cell.cells] = k
        self._all = int(np.count_nonzero(self._inside))
        self._all_found = 0
        self._times_s: dict[str, float | None] = dict.fromkeys(_SHARES)

    def update(self, tick: int, changed: NDArray[np.int64], states: NDArray[np.int8]) -> None:
        """Count cells whose state changed, and their new states; no cell twice."""
        free = states == FREE
        turned = changed[free != self._free[changed]]
        if not turned.size:
            return
        gained = ~self._free[turned]
        self._free[turned] = gained
        rates = list(self.rates)
        for layer in self._layers:
            for which, step in ((turned[gained], 1), (turned[~gained], -1)):
                counts = np.bincount(layer[which] + 1)
                for k in np.flatnonzero(counts[1:]).tolist():
                    self._found[k] += step * int(counts[k + 1])
                    rates[k] = self._found[k] / self._sizes[k]
        self.rates = tuple(rates)
        inside = self._inside[turned]
        self._all_found += int(np.count_nonzero(inside & gained)) - int(np.count_nonzero(inside & ~gained))
        self._note_times(seconds_of(tick))

    def _note_times(self, now_s: float) -> None:
        for k, rate in enumerate(self.rates):
            if self.search_time_s[k] is None and rate >= self._enough:
                self.search_time_s[k] = now_s
        for name, share in _SHARES.items():
            if self._times_s[name] is None and self.known_free >= share:
                self._times_s[name] = now_s

    @property
    def searched(self) -> bool:
        """All search cells are searched, now."""
        return bool(self.rates) and all(rate >= self._enough for rate in self.rates)

    @property
    def known_free(self) -> float:
        """Share of all search cells that is known to be free."""
        return self._all_found / self._all if self._all else 0.0

    def measures(self, states: NDArray[np.int8]) -> dict[str, Any]:
        """Of a map of these states: how much is found and when, how wrong it is, and what is left; in JSON types."""
        free_as_wall = int(np.count_nonzero(states[self._inside] == OCCUPIED))
        of_walls = states[self._walls]
        wall_as_free, wall_as_wall = (
            int(np.count_nonzero(of_walls == FREE)),
            int(np.count_nonzero(of_walls == OCCUPIED)),
        )
        return {
            "known_free": {"share": round(self.known_free, 6), **self._times_s},
            "map_errors": {
                "free_called_wall": round(free_as_wall / self._all, 6) if self._all else 0.0,
                "wall_called_free": round(wall_as_free / max(wall_as_free + wall_as_wall, 1), 6),
            },
            "left": {"called_wall": free_as_wall, "unknown": self._all - self._all_found - free_as_wall},
        }
