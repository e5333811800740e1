"""Search rate and search time per cell [paper 7.1]: the share of its area that was scanned, and when it became 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor_station.config import SearchCell
from world.grid import UNKNOWN
from world.terms import seconds_of


class SearchRate:
    """Counts, cell by cell, what the merged map knows."""

    def __init__(self, search_cells: tuple[SearchCell, ...], size: int) -> None:
        """`size`: number of grid cells."""
        self.names = [c.name for c in search_cells]
        self._members = [c.cells for c in search_cells]
        self._cell_of = np.full(size, -1, np.int16)
        for k, members in enumerate(self._members):
            self._cell_of[members] = k
        self.search_time_s: list[float | None] = [None] * len(search_cells)
        self.rates: tuple[float, ...] = (0.0,) * len(search_cells)

    def update(self, tick: int, changed: NDArray[np.int64], merged: NDArray[np.int8]) -> None:
        """Count again the search cells that have changed grid cells."""
        touched = np.unique(self._cell_of[changed])
        rates = list(self.rates)
        for k in touched[touched >= 0].tolist():
            members = self._members[k]
            rates[k] = float(np.count_nonzero(merged[members] != UNKNOWN)) / len(members)
            if rates[k] == 1.0 and self.search_time_s[k] is None:
                self.search_time_s[k] = seconds_of(tick)
        self.rates = tuple(rates)

    @property
    def searched(self) -> bool:
        """All cells are searched."""
        return bool(self.rates) and all(rate == 1.0 for rate in self.rates)
