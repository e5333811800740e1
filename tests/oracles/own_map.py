"""What a scan shows and is worth, cells from elsewhere and lines over a map, by numpy: the oracle of agents/_cells.pyx.

It keeps hits and misses apart for each cell, and reads the odds anew each time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from agents.own_map import OwnMap, frontiers
from world.grid import FREE, OCCUPIED, UNKNOWN


class OracleMap(OwnMap):
    """A map that uses no compiled loop."""

    def __init__(self, config: RobotConfig) -> None:
        super().__init__(config)
        self._config = config
        self._hits = np.zeros(self.cells.size, int)
        self._misses = np.zeros(self.cells.size, int)

    def _score(self) -> NDArray[np.int64]:
        model, told = self._sensors, self._odds.astype(np.int64)
        score: NDArray[np.int64] = (
            np.where(told > 0, told * model.worth, told) + model.worth * self._hits - model.miss * self._misses
        )
        return score

    def _read(self, score: NDArray[np.int64]) -> NDArray[np.int64]:
        read: NDArray[np.int64] = np.clip(
            np.where(score > 0, np.ceil(score / self._sensors.worth), score),
            -self._sensors.settled,
            self._sensors.settled,
        ).astype(np.int64)
        return read

    def _refresh(self) -> NDArray[np.int64]:
        score = self._score()
        states = np.where(score > 0, OCCUPIED, np.where(score < 0, FREE, UNKNOWN)).astype(np.int8)
        changed: NDArray[np.int64] = np.flatnonzero(states != self.cells)
        lost = int(np.count_nonzero(self.cells[changed] == FREE))
        self.cells[:] = states
        self._note(changed, lost)
        return changed

    def _farther(
        self, cells: NDArray[np.int64], x_m: float, y_m: float, ranges_m: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Of the beam that points at each cell, and of the second one beside its center: which go farther; (2, n)."""
        g, beams = self.geometry, self._config.lidar_beams
        rows, cols = np.divmod(cells, g.cols)
        dx = g.x0_m + (cols + 0.5) * g.resolution_m - x_m
        dy = g.y0_m + (rows + 0.5) * g.resolution_m - y_m
        toward = np.arctan2(dy, dx) * (beams / (2.0 * math.pi))
        pointing = np.rint(toward)
        second = np.where(toward > pointing, pointing + 1, pointing - 1)
        away = np.hypot(dx, dy)
        return np.array([away < ranges_m[beam.astype(np.int64) % beams] for beam in (pointing, second)])

    def _missed(
        self, x_m: float, y_m: float, ranges_m: NDArray[np.float64], hit: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        score = self._score()
        cells = np.flatnonzero(self._read(score - self._sensors.miss) != self._read(score))
        farther = self._farther(cells, x_m, y_m, ranges_m)
        seen = farther[0] if self._sensors.exact else farther.all(axis=0)
        free: NDArray[np.int64] = cells[seen & ~np.isin(cells, hit)]
        return free

    def _hit(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        g = self.geometry
        beam = np.flatnonzero(ranges_m < self._config.lidar_range_m)
        reach = ranges_m[beam] + self._sensors.into_wall_m
        angles = 2.0 * math.pi * np.arange(self._config.lidar_beams) / self._config.lidar_beams
        cols = np.floor((x_m + reach * np.cos(angles)[beam] - g.x0_m) / g.resolution_m).astype(np.int64)
        rows = np.floor((y_m + reach * np.sin(angles)[beam] - g.y0_m) / g.resolution_m).astype(np.int64)
        inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
        ends: NDArray[np.int64] = np.unique(rows[inside] * g.cols + cols[inside])
        return ends if self._sensors.exact else ends[~self._farther(ends, x_m, y_m, ranges_m).any(axis=0)]

    def _weigh(self, cells: NDArray[np.int64], evidence: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        score = self._score()[cells]
        counted = cells[self._read(score + evidence) != self._read(score)]
        (self._hits if evidence > 0 else self._misses)[counted] += 1
        changed = self._refresh()
        return counted, counted[np.isin(counted, changed)]

    def apply(self, cells: NDArray[np.uint32], odds: NDArray[np.int8]) -> None:
        for cell, value in zip(cells.tolist(), odds.tolist(), strict=True):
            self._odds[cell] = value
        self._refresh()

    def forget(self, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        self._hits[cells[values == OCCUPIED]] -= 1
        self._misses[cells[values == FREE]] -= 1
        self._refresh()

    def is_frontier(self, index: int) -> bool:
        return index in self.frontiers()

    def frontiers(self) -> NDArray[np.int64]:
        return frontiers(self.cells, self.geometry)

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
