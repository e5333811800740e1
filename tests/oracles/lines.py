"""Walls on segments, all segments at once: the oracle of world/grid/_lines.pyx."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry


def walls_crossed(
    occupied: NDArray[np.bool_], geometry: GridGeometry, a_xy: NDArray[np.float64], b_xy: NDArray[np.float64]
) -> NDArray[np.int64]:
    """As world.grid.lines.walls_crossed."""
    if len(a_xy) == 0:
        return np.zeros(0, np.int64)
    origin = (geometry.x0_m, geometry.y0_m)
    a, b = (a_xy - origin) / geometry.resolution_m, (b_xy - origin) / geometry.resolution_m
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
    base = along.astype(np.int64) * np.where(steep, geometry.cols, 1)[:, None]
    across_stride = np.where(steep, 1, geometry.cols)[:, None]
    cells = np.empty((len(a), 2 * len(steps)), np.int64)
    cells[:, 0::2] = base + minor[:, :-1] * across_stride
    cells[:, 1::2] = base + minor[:, 1:] * across_stride
    wall = occupied.ravel().take(cells, mode="clip")
    rises: NDArray[np.int64] = np.count_nonzero(wall[:, 1:] & ~wall[:, :-1], axis=1)
    return rises + wall[:, 0]
