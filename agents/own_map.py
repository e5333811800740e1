"""A robot's own map: what its lidar saw and what the MS sent down, and the graph of cells that it may walk.

Free cells come from the inverse range-sensor model of Thrun, Burgard & Fox, Probabilistic Robotics, table 9.2: a cell
is free if its center is nearer than the range of the beam that points at it. Occupied beats free beats unknown.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from world.compiled import kernels
from world.grid import FREE, OCCUPIED, UNKNOWN

_INTO_WALL_M: Final = 1e-9
"""How far behind the point of impact the wall's cell begins; ranges are exact, so rounding is all that it must beat."""

_ENDS: Final = np.array([0.0, 1.0])
_NONE: Final = np.zeros(0, np.int64)


class OwnMap:
    """Cells in {UNKNOWN, FREE, OCCUPIED}, flat, in the geometry that the whole run shares."""

    def __init__(self, config: RobotConfig) -> None:
        self.geometry = config.geometry
        self._range_m = config.lidar_range_m
        self._beams = config.lidar_beams
        self._beams_per_radian = config.lidar_beams / (2.0 * math.pi)
        angles = 2.0 * math.pi * np.arange(config.lidar_beams) / config.lidar_beams
        self._cos, self._sin = np.cos(angles), np.sin(angles)
        self._reach = math.ceil(config.lidar_range_m / self.geometry.resolution_m) + 1
        steps = np.arange(-self._reach, self._reach + 1)
        d_row, d_col = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
        near = np.hypot(d_row, d_col) * self.geometry.resolution_m <= config.lidar_range_m + self.geometry.resolution_m
        self._d_row, self._d_col = d_row[near], d_col[near]
        self._offsets = self._d_row * self.geometry.cols + self._d_col
        self.cells: NDArray[np.int8] = np.full(self.geometry.size, UNKNOWN, np.int8)
        self.cells[self.geometry.rectangle(*config.safety_zone_m)] = FREE
        self.version = 0
        """Rises with every change."""
        self._changed = [np.flatnonzero(self.cells == FREE)]

    def integrate(
        self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
        """Take a scan from a place into the map; returns the cells that changed and their new values.

        Raises:
            ValueError: the scan has not the configured number of beams.
        """
        if len(ranges_m) != self._beams:
            raise ValueError(f"a scan has {self._beams} ranges, not {len(ranges_m)}")
        free = self._seen_free(x_m, y_m, ranges_m)
        hit = self._hit(x_m, y_m, ranges_m)
        if not free.size and not hit.size:
            return free, self.cells[:0]
        self.cells[free] = FREE
        self.cells[hit] = OCCUPIED
        self.version += 1
        changed = np.concatenate((free[self.cells[free] == FREE], hit))
        self._changed.append(changed)
        return changed, self.cells[changed]

    def _around(self, index: int) -> NDArray[np.int64]:
        """The cells within lidar range of a cell."""
        g, reach = self.geometry, self._reach
        row, col = divmod(index, g.cols)
        if reach <= row < g.rows - reach and reach <= col < g.cols - reach:
            window: NDArray[np.int64] = index + self._offsets
            return window
        rows, cols = row + self._d_row, col + self._d_col
        inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
        cells: NDArray[np.int64] = rows[inside] * g.cols + cols[inside]
        return cells

    def _seen_free(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Unknown cells that a scan shows to be free."""
        g = self.geometry
        if kernels is not None:
            free: NDArray[np.int64] = kernels.seen_free(
                self.cells, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m, g.index(x_m, y_m),
                self._d_row, self._d_col, ranges_m, self._beams_per_radian,
            )  # fmt: skip
            return free
        around = self._around(g.index(x_m, y_m))
        cells: NDArray[np.int64] = around[self.cells[around] == UNKNOWN]
        if not cells.size:
            return cells
        rows, cols = np.divmod(cells, g.cols)
        dx = g.x0_m + (cols + 0.5) * g.resolution_m - x_m
        dy = g.y0_m + (rows + 0.5) * g.resolution_m - y_m
        beam = np.rint(np.arctan2(dy, dx) * self._beams_per_radian).astype(np.int64) % self._beams
        seen: NDArray[np.int64] = cells[np.hypot(dx, dy) < ranges_m[beam]]
        return seen

    def _hit(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cells not yet known as walls that a scan shows to be walls."""
        g = self.geometry
        cells: NDArray[np.int64]
        if kernels is not None:
            cells = kernels.hit(
                self.cells, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m,
                ranges_m, self._cos, self._sin, self._range_m, _INTO_WALL_M,
            )  # fmt: skip
        else:
            beam = np.flatnonzero(ranges_m < self._range_m)
            reach = ranges_m[beam] + _INTO_WALL_M
            cols = np.floor((x_m + reach * self._cos[beam] - g.x0_m) / g.resolution_m).astype(np.int64)
            rows = np.floor((y_m + reach * self._sin[beam] - g.y0_m) / g.resolution_m).astype(np.int64)
            inside = (rows >= 0) & (rows < g.rows) & (cols >= 0) & (cols < g.cols)
            met = rows[inside] * g.cols + cols[inside]
            cells = met[self.cells[met] != OCCUPIED]
        return np.array(sorted(set(cells.tolist())), np.int64)

    def apply(self, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        """Merge cells from elsewhere.

        Raises:
            IndexError: a cell lies outside the grid.
        """
        if kernels is not None:
            new: NDArray[np.int64] = kernels.apply(self.cells, cells, values)
            if new.size:
                self._changed.append(new)
                self.version += 1
            return
        better = values > self.cells[cells]
        if better.any():
            # A cell that occurs twice turned from free to occupied: the last value stays.
            changed = cells[better].astype(np.int64)
            self.cells[changed] = values[better]
            self._changed.append(changed)
            self.version += 1

    def changes(self, since: int) -> tuple[NDArray[np.int64], int]:
        """The cells that changed, in any order, some perhaps twice, and what to ask with the next time (at first 0)."""
        new = self._changed[since:]
        return np.concatenate(new) if new else _NONE, len(self._changed)

    def is_frontier(self, index: int) -> bool:
        """Known free, next to unknown (4 neighbors); the border of the grid counts as known."""
        cells, cols = self.cells, self.geometry.cols
        if kernels is not None:
            return bool(kernels.is_frontier(cells, cols, index))
        if cells[index] != FREE:
            return False
        col = index % cols
        return bool(
            (col > 0 and cells[index - 1] == UNKNOWN)
            or (col < cols - 1 and cells[index + 1] == UNKNOWN)
            or (index >= cols and cells[index - cols] == UNKNOWN)
            or (index + cols < cells.size and cells[index + cols] == UNKNOWN)
        )

    def frontiers(self) -> NDArray[np.int64]:
        """Flat indices, ascending, of all frontier cells."""
        grid = self.cells.reshape(self.geometry.rows, self.geometry.cols)
        unknown = grid == UNKNOWN
        beside = np.zeros_like(unknown)
        beside[1:] |= unknown[:-1]
        beside[:-1] |= unknown[1:]
        beside[:, 1:] |= unknown[:, :-1]
        beside[:, :-1] |= unknown[:, 1:]
        beside &= grid == FREE
        return np.flatnonzero(beside)

    def clear_line(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> bool:
        """Every cell on a segment is known free."""
        return self.obstacles(x0_m, y0_m, x1_m, y1_m) == 0

    def obstacles(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> int:
        """Contiguous runs of cells on a segment that are not known to be free; all that is outside counts as one.

        Between two crossings of grid lines lies one cell.
        """
        g = self.geometry
        u0, v0 = (x0_m - g.x0_m) / g.resolution_m, (y0_m - g.y0_m) / g.resolution_m
        du, dv = (x1_m - x0_m) / g.resolution_m, (y1_m - y0_m) / g.resolution_m
        if not (0.0 <= u0 + du < g.cols and 0.0 <= v0 + dv < g.rows):
            return 1  # a peer may say that it is anywhere
        if kernels is not None:
            return int(kernels.obstacles(self.cells, g.cols, u0, v0, du, dv))
        u_lines = np.arange(math.floor(min(u0, u0 + du)) + 1, math.ceil(max(u0, u0 + du)))
        v_lines = np.arange(math.floor(min(v0, v0 + dv)) + 1, math.ceil(max(v0, v0 + dv)))
        parts = [_ENDS]
        if len(u_lines):
            parts.append((u_lines - u0) / du)
        if len(v_lines):
            parts.append((v_lines - v0) / dv)
        t = np.concatenate(parts)
        t.sort()
        middle = 0.5 * (t[1:] + t[:-1])
        cols, rows = (u0 + middle * du).astype(np.int64), (v0 + middle * dv).astype(np.int64)
        solid = self.cells[rows * g.cols + cols] != FREE
        return int(solid[0]) + int(np.count_nonzero(solid[1:] & ~solid[:-1]))
