"""Search rate and search time per cell [paper 7.1]: the share of its area that was scanned, and when it became 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor_station.config import SearchCell
from world.terms import seconds_of


class SearchRate:
    """Counts the known grid cells of each search cell."""

    def __init__(self, search_cells: tuple[SearchCell, ...], size: int) -> None:
        """`size`: number of grid cells."""
        self.names = [c.name for c in search_cells]
        self.search_time_s: list[float | None] = [None] * len(search_cells)
        self.rates: tuple[float, ...] = (0.0,) * len(search_cells)
        self._sizes = [len(c.cells) for c in search_cells]
        self._scanned = [0] * len(search_cells)
        self._known: NDArray[np.bool_] = np.zeros(size, np.bool_)
        self._layers: list[NDArray[np.int16]] = []
        """The search cell that holds each grid cell, or -1; those that overlap are in different layers."""
        for k, cell in enumerate(search_cells):
            layer = next((layer for layer in self._layers if (layer[cell.cells] < 0).all()), None)
            if layer is None:
                layer = np.full(size, -1, np.int16)
                self._layers.append(layer)
            layer[cell.cells] = k

    def update(self, tick: int, changed: NDArray[np.int64]) -> None:
        """Count the grid cells that the map now knows; `changed`: no cell twice."""
        new = changed[~self._known[changed]]
        self._known[new] = True
        rates = list(self.rates)
        for layer in self._layers:
            counts = np.bincount(layer[new] + 1)
            for k in np.flatnonzero(counts[1:]).tolist():
                count = int(counts[k + 1])
                self._scanned[k] += count
                rates[k] = self._scanned[k] / self._sizes[k]
                if self._scanned[k] == self._sizes[k]:
                    self.search_time_s[k] = seconds_of(tick)
        self.rates = tuple(rates)

    @property
    def searched(self) -> bool:
        """All cells are searched."""
        return bool(self.rates) and all(rate == 1.0 for rate in self.rates)
