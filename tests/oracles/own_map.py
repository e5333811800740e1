"""What a scan shows, cells from elsewhere and lines over a map, by numpy: the oracle of agents/_cells.pyx."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from agents.own_map import OwnMap
from world.grid import FREE, OCCUPIED, UNKNOWN


class OracleMap(OwnMap):
    """A map that uses no compiled loop."""

    def __init__(self, config: RobotConfig) -> None:
        super().__init__(config)
        self._config = config

    def _seen_free(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        g, beams = self.geometry, self._config.lidar_beams
        at_row, at_col = divmod(g.index(x_m, y_m), g.cols)
        rows, cols = at_row + self._d_row, at_col + self._d_col
        inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
        around = rows[inside] * g.cols + cols[inside]
        cells: NDArray[np.int64] = around[self.cells[around] == UNKNOWN]
        rows, cols = np.divmod(cells, g.cols)
        dx = g.x0_m + (cols + 0.5) * g.resolution_m - x_m
        dy = g.y0_m + (rows + 0.5) * g.resolution_m - y_m
        beam = np.rint(np.arctan2(dy, dx) * (beams / (2.0 * math.pi))).astype(np.int64) % beams
        seen: NDArray[np.int64] = cells[np.hypot(dx, dy) < ranges_m[beam]]
        return seen

    def _hit(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        g = self.geometry
        beam = np.flatnonzero(ranges_m < self._config.lidar_range_m)
        reach = ranges_m[beam] + 1e-9
        angles = 2.0 * math.pi * np.arange(self._config.lidar_beams) / self._config.lidar_beams
        cols = np.floor((x_m + reach * np.cos(angles)[beam] - g.x0_m) / g.resolution_m).astype(np.int64)
        rows = np.floor((y_m + reach * np.sin(angles)[beam] - g.y0_m) / g.resolution_m).astype(np.int64)
        inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
        met = rows[inside] * g.cols + cols[inside]
        return np.unique(met[self.cells[met] != OCCUPIED])

    def apply(self, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        better = values > self.cells[cells]
        if better.any():
            # A cell that occurs twice turned from free to occupied: the last value stays.
            changed = cells[better].astype(np.int64)
            self.cells[changed] = values[better]
            self._changed.append(changed)
            self.version += 1

    def is_frontier(self, index: int) -> bool:
        return index in self.frontiers()

    def obstacles(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> int:
        g = self.geometry
        u0, v0 = (x0_m - g.x0_m) / g.resolution_m, (y0_m - g.y0_m) / g.resolution_m
        du, dv = (x1_m - x0_m) / g.resolution_m, (y1_m - y0_m) / g.resolution_m
        if not all(0.0 <= u < g.cols for u in (u0, u0 + du)) or not all(0.0 <= v < g.rows for v in (v0, v0 + dv)):
            return 1
        parts = [np.array([0.0, 1.0])]
        for start, length in ((u0, du), (v0, dv)):
            lines = np.arange(math.floor(min(start, start + length)) + 1, math.ceil(max(start, start + length)))
            if len(lines):
                parts.append((lines - start) / length)
        t = np.sort(np.concatenate(parts))
        middle = 0.5 * (t[1:] + t[:-1])
        cols, rows = (u0 + middle * du).astype(np.int64), (v0 + middle * dv).astype(np.int64)
        solid = self.cells[rows * g.cols + cols] != FREE
        return int(solid[0]) + int(np.count_nonzero(solid[1:] & ~solid[:-1]))
