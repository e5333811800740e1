"""A robot's own map: the cells that its lidar saw, and those that the MS sent down.

Free cells come from the inverse range-sensor model of Thrun, Burgard & Fox, Probabilistic Robotics, table 9.2: a cell
is free if its center is nearer than the range of the beam that points at it. Occupied beats free beats unknown.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import _cells
from agents.config import RobotConfig
from world.grid import FREE, OCCUPIED, UNKNOWN

_INTO_WALL_M: Final = 1e-9
"""How far behind the end of a beam the wall's cell is looked up. Ranges are exact, so this only outdoes rounding."""

_NONE: Final = np.zeros(0, np.int64)


class OwnMap:
    """Cells in {UNKNOWN, FREE, OCCUPIED}, flat, in the grid that all maps of the run share."""

    def __init__(self, config: RobotConfig) -> None:
        self.geometry = config.geometry
        self._range_m = config.lidar_range_m
        self._beams = config.lidar_beams
        self._beams_per_radian = config.lidar_beams / (2.0 * math.pi)
        angles = 2.0 * math.pi * np.arange(config.lidar_beams) / config.lidar_beams
        self._cos, self._sin = np.cos(angles), np.sin(angles)
        reach = math.ceil(config.lidar_range_m / self.geometry.resolution_m) + 1
        steps = np.arange(-reach, reach + 1)
        d_row, d_col = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
        near = np.hypot(d_row, d_col) * self.geometry.resolution_m <= config.lidar_range_m + self.geometry.resolution_m
        self._d_row, self._d_col = d_row[near], d_col[near]
        self.cells = self.geometry.blank(config.safety_zone_m)
        self.version = 0
        """Rises with every change."""
        self._changed = [np.flatnonzero(self.cells == FREE)]

    def integrate(
        self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
        """Integrate a scan taken at a place; returns the cells that changed and their new values.

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

    def _seen_free(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Unknown cells that a scan shows to be free."""
        g = self.geometry
        return _cells.seen_free(
            self.cells, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m, g.index(x_m, y_m),
            self._d_row, self._d_col, ranges_m, self._beams_per_radian,
        )  # fmt: skip

    def _hit(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cells, ascending, that a scan shows to be walls and that are not yet known as such."""
        g = self.geometry
        cells = _cells.hit(
            self.cells, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m,
            ranges_m, self._cos, self._sin, self._range_m, _INTO_WALL_M,
        )  # fmt: skip
        return np.array(sorted(set(cells.tolist())), np.int64)

    def apply(self, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        """Merge cells that came from the MS.

        Raises:
            IndexError: a cell lies outside the grid.
        """
        new = _cells.apply(self.cells, cells, values)
        if new.size:
            self._changed.append(new)
            self.version += 1

    def changes(self, since: int) -> tuple[NDArray[np.int64], int]:
        """Cells that changed since a mark (0 at first), in any order, some perhaps twice; and the next mark."""
        new = self._changed[since:]
        return np.concatenate(new) if new else _NONE, len(self._changed)

    def is_frontier(self, index: int) -> bool:
        """Whether a cell is known free and one of its four neighbors unknown; outside of the grid counts as known."""
        return _cells.is_frontier(self.cells, self.geometry.cols, index)

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
        """Whether every cell on a segment is known free."""
        return self.obstacles(x0_m, y0_m, x1_m, y1_m) == 0

    def obstacles(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> int:
        """Number of contiguous runs of cells on a segment that are not known to be free; 1 if it leaves the grid.

        Between two crossings of grid lines lies one cell.
        """
        g = self.geometry
        u0, v0 = (x0_m - g.x0_m) / g.resolution_m, (y0_m - g.y0_m) / g.resolution_m
        du, dv = (x1_m - x0_m) / g.resolution_m, (y1_m - y0_m) / g.resolution_m
        # A peer may announce any location, and noise may put a robot outside of the grid.
        if not (0.0 <= u0 < g.cols and 0.0 <= v0 < g.rows and 0.0 <= u0 + du < g.cols and 0.0 <= v0 + dv < g.rows):
            return 1
        return _cells.obstacles(self.cells, g.cols, u0, v0, du, dv)
