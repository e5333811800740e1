"""Straight lines through an occupancy grid: which walls lie between two places.

A segment is followed strip by strip along its longer axis. Since it climbs at most one cell per strip, it touches
at most two cells of each, the one where it enters and the one where it leaves; that is exact, and needs no sorting
of crossings (compare Amanatides & Woo 1987, who step cell by cell).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from world.compiled import kernels
from world.grid import GridGeometry

__all__ = ["line_of_sight", "pad", "walls_crossed"]


def pad(occupied: NDArray[np.bool_], geometry: GridGeometry, cells: int = 1) -> tuple[NDArray[np.bool_], GridGeometry]:
    """The grid with a frame of walls around it, `cells` wide: outside a floor plan is wall."""
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
    crossed: NDArray[np.int64]
    starts, ends = np.asarray(a_xy, np.float64), np.asarray(b_xy, np.float64)
    if starts.shape != ends.shape:
        raise ValueError(f"segments from {len(starts)} to {len(ends)} places")
    if kernels is not None:
        g = geometry
        crossed = kernels.walls_crossed(occupied.reshape(-1), g.cols, g.resolution_m, g.x0_m, g.y0_m, starts, ends)
        return crossed
    if len(starts) == 0:
        return np.zeros(0, np.int64)
    origin = (geometry.x0_m, geometry.y0_m)
    a = (starts - origin) / geometry.resolution_m
    b = (ends - origin) / geometry.resolution_m
    span = np.abs(b - a)
    steep = span[:, 1] > span[:, 0]
    a[steep] = a[steep, ::-1]
    b[steep] = b[steep, ::-1]
    # Each segment is walked from its end with the lower coordinate, so that swapping a and b changes nothing.
    backwards = (a[:, 0] > b[:, 0])[:, None]
    start, end = np.where(backwards, b, a), np.where(backwards, a, b)

    first = np.floor(start[:, 0])
    strips = np.floor(end[:, 0]) - first
    length = end[:, 0] - start[:, 0]
    slope = np.divide(end[:, 1] - start[:, 1], length, out=np.zeros_like(length), where=length > 0)
    steps = np.arange(int(strips.max()) + 1, dtype=np.float64)
    along = np.minimum(steps, strips[:, None]) + first[:, None]
    leave = np.minimum(along + 1.0, end[:, :1]) - start[:, :1]
    across = np.empty((len(a), len(steps) + 1))
    across[:, 0] = start[:, 1]
    across[:, 1:] = start[:, 1:] + slope[:, None] * leave
    minor = np.floor(across).astype(np.int64)
    major = along.astype(np.int64)

    along_stride = np.where(steep, geometry.cols, 1)[:, None]
    across_stride = np.where(steep, 1, geometry.cols)[:, None]
    base = major * along_stride
    cells = np.empty((len(a), 2 * len(steps)), np.int64)
    cells[:, 0::2] = base + minor[:, :-1] * across_stride
    cells[:, 1::2] = base + minor[:, 1:] * across_stride
    wall = occupied.ravel().take(cells, mode="clip")
    rises = np.count_nonzero(wall[:, 1:] & ~wall[:, :-1], axis=1)
    crossed = rises + wall[:, 0]
    return crossed


def line_of_sight(
    occupied: NDArray[np.bool_], geometry: GridGeometry, a: tuple[float, float], b: tuple[float, float]
) -> bool:
    """Whether no wall lies between two places inside the grid."""
    if kernels is not None:
        g = geometry
        walls: int = kernels.crossed_by(occupied.reshape(-1), g.cols, g.resolution_m, g.x0_m, g.y0_m, *a, *b)
        return walls == 0
    return not walls_crossed(occupied, geometry, np.array([a]), np.array([b]))[0]
