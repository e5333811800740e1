"""Straight lines through an occupancy grid: which walls lie between two places.

A segment is followed strip by strip along its longer axis. Since it climbs at most one cell per strip, it touches
at most two cells of each, the one where it enters and the one where it leaves; that is exact, and needs no sorting
of crossings (compare Amanatides & Woo 1987, who step cell by cell).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from world.grid import _lines
from world.grid.geometry import GridGeometry

__all__ = ["line_of_sight", "pad", "walls_crossed"]


def pad(occupied: NDArray[np.bool_], geometry: GridGeometry, cells: int = 1) -> tuple[NDArray[np.bool_], GridGeometry]:
    """The grid with a rim of walls around it, `cells` wide: outside a floor plan is wall."""
    margin = cells * geometry.resolution_m
    wider = GridGeometry(
        geometry.rows + 2 * cells,
        geometry.cols + 2 * cells,
        geometry.resolution_m,
        geometry.x0_m - margin,
        geometry.y0_m - margin,
    )
    return np.pad(np.asarray(occupied, np.bool_), cells, constant_values=True), wider


def walls_crossed(
    occupied: NDArray[np.bool_],
    geometry: GridGeometry,
    a_xy: NDArray[np.float64],
    b_xy: NDArray[np.float64],
) -> NDArray[np.int64]:
    """How many walls, contiguous runs of occupied cells, lie on each segment a[i] - b[i].

    Args:
        occupied: (rows, cols), True = wall.
        geometry: of `occupied`.
        a_xy: (n, 2) in metres, inside the grid.
        b_xy: (n, 2) in metres, inside the grid.

    Returns:
        (n,) counts, exactly the same when a and b are swapped.
    """
    g = geometry
    starts, ends = np.asarray(a_xy, np.float64), np.asarray(b_xy, np.float64)
    if starts.shape != ends.shape:
        raise ValueError(f"segments from {len(starts)} to {len(ends)} places")
    return _lines.walls_crossed(occupied.reshape(-1), g.cols, g.resolution_m, g.x0_m, g.y0_m, starts, ends)


def line_of_sight(
    occupied: NDArray[np.bool_], geometry: GridGeometry, a: tuple[float, float], b: tuple[float, float]
) -> bool:
    """Whether no wall lies between two places inside the grid."""
    g = geometry
    return not _lines.crossed_by(occupied.reshape(-1), g.cols, g.resolution_m, g.x0_m, g.y0_m, *a, *b)
