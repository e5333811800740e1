"""Occupancy grids: int8 cells in row-major order, row 0 at the lowest y. Walls of a floor plan follow cell borders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

UNKNOWN: Final = -1
FREE: Final = 0
OCCUPIED: Final = 1

MAX_CELLS: Final = 25_000_000
FINEST_M: Final = 0.001
FARTHEST_M: Final = 20_000.0
"""Places travel as whole numbers of 10 um in 32 bits, and are recorded in single precision."""


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Where a grid lies. All who share a map agree on it before the run."""

    rows: int
    cols: int
    resolution_m: float = 0.5
    x0_m: float = 0.0
    """x of the lower-left corner of cell (0, 0)."""
    y0_m: float = 0.0

    def __reduce__(self) -> tuple[type[GridGeometry], tuple[int, int, float, float, float]]:
        """Make it picklable, which compiled classes are not by themselves."""
        return GridGeometry, (self.rows, self.cols, self.resolution_m, self.x0_m, self.y0_m)

    @property
    def size(self) -> int:
        return self.rows * self.cols

    def blank(self, free_m: tuple[float, float, float, float]) -> NDArray[np.int8]:
        """(size,) cells of a map that knows nothing but that a rectangle is free: x0, y0, x1, y1."""
        cells: NDArray[np.int8] = np.full(self.size, UNKNOWN, np.int8)
        cells[self.rectangle(*free_m)] = FREE
        return cells

    def holds(self, cells: NDArray[np.uint32]) -> bool:
        """Whether all of these flat indices are cells."""
        return not cells.size or int(cells.max()) < self.size

    def covers(self, x_m: float, y_m: float) -> bool:
        """Whether a place lies on the grid."""
        x1_m, y1_m = self.x0_m + self.cols * self.resolution_m, self.y0_m + self.rows * self.resolution_m
        return self.x0_m <= x_m <= x1_m and self.y0_m <= y_m <= y1_m

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Row and column of the cell that holds a place, in the grid or not.

        The loops divide and round down alike, so that on a border between two cells all name the same one.
        """
        return math.floor((y_m - self.y0_m) / self.resolution_m), math.floor((x_m - self.x0_m) / self.resolution_m)

    def index(self, x_m: float, y_m: float) -> int:
        """Flat index of the cell that holds a place; places outside are clamped to the border cells."""
        row, col = self.cell(x_m, y_m)
        return min(max(row, 0), self.rows - 1) * self.cols + min(max(col, 0), self.cols - 1)

    def center(self, index: int) -> tuple[float, float]:
        """Center of a cell in metres."""
        row, col = divmod(index, self.cols)
        return self.x0_m + (col + 0.5) * self.resolution_m, self.y0_m + (row + 0.5) * self.resolution_m

    def centers(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centers of cells, shape (n, 2), in metres."""
        rows, cols = np.divmod(indices, self.cols)
        return np.column_stack(
            (
                self.x0_m + (cols + 0.5) * self.resolution_m,
                self.y0_m + (rows + 0.5) * self.resolution_m,
            )
        )

    def rectangle(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> NDArray[np.int64]:
        """Flat indices, ascending, of the cells whose centers lie in a rectangle."""
        y = self.y0_m + (np.arange(self.rows) + 0.5) * self.resolution_m
        x = self.x0_m + (np.arange(self.cols) + 0.5) * self.resolution_m
        rows, cols = np.flatnonzero((y > y0_m) & (y < y1_m)), np.flatnonzero((x > x0_m) & (x < x1_m))
        inside: NDArray[np.int64] = (rows[:, None] * self.cols + cols).ravel()
        return inside


def check_grid(rows: int, cols: int, resolution_m: float, x0_m: float = 0.0, y0_m: float = 0.0) -> GridGeometry:
    """The geometry, if a run can have it; to be called before anything of that size is made.

    Raises:
        ValueError: it has no cells or too many, they are too small, or it lies too far away.
    """
    if not 0 < rows * cols <= MAX_CELLS:
        raise ValueError(f"a grid of {rows:,} x {cols:,} cells; up to {MAX_CELLS:,} are possible")
    if not resolution_m >= FINEST_M:
        raise ValueError(f"a resolution of {resolution_m:g} m; {FINEST_M:g} m or more is possible")
    farthest = max(abs(x0_m), abs(y0_m), abs(x0_m + cols * resolution_m), abs(y0_m + rows * resolution_m))
    if not farthest <= FARTHEST_M:
        raise ValueError(
            f"a floor as far as {farthest:.9g} m from (0, 0); up to {FARTHEST_M:,g} m is possible: move its origin"
        )
    return GridGeometry(rows, cols, resolution_m, x0_m, y0_m)
