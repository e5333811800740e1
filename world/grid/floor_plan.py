"""Floor plans carved out of wall or resampled, and which parts of a floor are connected."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from world.grid.geometry import MAX_CELLS, GridGeometry, check_grid

__all__ = ["clearance", "connected_parts", "from_rectangles", "reachable", "resampled"]

_Corners = tuple[float, float, float, float]
"""x0, y0, x1, y1 in metres."""


def from_rectangles(
    size_m: tuple[float, float], free: Sequence[_Corners], walls: Sequence[_Corners], resolution_m: float
) -> tuple[NDArray[np.bool_], GridGeometry]:
    """Carve `free` out of solid wall, then put `walls` back; a cell belongs to a rectangle that holds its center.

    Returns:
        (rows, cols) True = wall, and its geometry with the origin at (0, 0).

    Raises:
        ValueError: a rectangle is empty or outside, or the grid is too large.
    """
    # Bounded first: there is no integer for the quotient of a large number and a small one.
    cols, rows = (math.ceil(round(min(length / resolution_m, MAX_CELLS + 1.0), 6)) for length in size_m)
    geometry = check_grid(rows, cols, resolution_m)
    occupied = np.ones(geometry.size, np.bool_)
    for name, rectangles, wall in (("free", free, False), ("walls", walls, True)):
        for i, (x0, y0, x1, y1) in enumerate(rectangles, 1):
            which = f"{name}[{i}] = {x0:g}, {y0:g}, {x1:g}, {y1:g}"
            if x0 >= x1 or y0 >= y1:
                raise ValueError(f"{which}: a rectangle is x0, y0, x1, y1 with x0 < x1 and y0 < y1")
            if x0 < 0 or y0 < 0 or x1 > size_m[0] or y1 > size_m[1]:
                raise ValueError(f"{which}: outside size_m = {size_m[0]:g}, {size_m[1]:g}")
            occupied[geometry.rectangle(x0, y0, x1, y1)] = wall
    return occupied.reshape(rows, cols), geometry


def resampled(
    occupied: NDArray[np.bool_], geometry: GridGeometry, resolution_m: float
) -> tuple[NDArray[np.bool_], GridGeometry]:
    """The same floor in cells of another size: a cell that shares any area with a wall is wall.

    What lies outside the grid is wall, so a last row or column that reaches beyond it is wall.

    Returns:
        (rows, cols) True = wall, and its geometry, with the lower-left corner where it was.

    Raises:
        ValueError: no run can have such a grid.
    """
    ratio = resolution_m / geometry.resolution_m
    rows, cols = (max(1, math.ceil(round(min(count / ratio, MAX_CELLS + 1.0), 6))) for count in occupied.shape)
    new = check_grid(rows, cols, resolution_m, geometry.x0_m, geometry.y0_m)
    walls = occupied
    for axis, count in enumerate((rows, cols)):
        edges = (np.arange(count + 1) * ratio).round(6)
        first, end = np.floor(edges[:-1]).astype(np.int64), np.ceil(edges[1:]).astype(np.int64)
        outside = end > walls.shape[axis]
        before = np.insert(np.cumsum(walls, axis, dtype=np.int32), 0, 0, axis)
        counts = before.take(np.minimum(end, walls.shape[axis]), axis) - before.take(first, axis)
        walls = (counts > 0) | np.expand_dims(outside, 1 - axis)
    return walls, new


def connected_parts(occupied: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(rows, cols) number of the part of the floor that a cell belongs to, from 1; 0 for a wall.

    Cells are connected over their sides.
    """
    from scipy import ndimage  # late: who only carves rectangles need not wait for it

    parts: NDArray[np.int32] = ndimage.label(~occupied)[0]
    return parts


def reachable(occupied: NDArray[np.bool_], index: int) -> NDArray[np.bool_]:
    """(rows, cols) True = free and connected to the cell `index`; all False if that is a wall."""
    parts = connected_parts(occupied)
    reached: NDArray[np.bool_] = (parts == parts.flat[index]) & ~occupied
    return reached


def clearance(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(rows, cols) cells from each free cell to the nearest that is not, diagonal steps counting as one; 0 for those.

    What lies outside is not free.
    """
    from scipy import ndimage

    distance: NDArray[np.int32] = ndimage.distance_transform_cdt(np.pad(free, 1), "chessboard")[1:-1, 1:-1]
    return distance
