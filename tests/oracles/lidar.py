"""A scan by all crossings of all beams at once: the oracle of world/_lidar.pyx."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.grid.lines import pad


def cast(
    occupied: NDArray[np.bool_], geometry: GridGeometry, x_m: float, y_m: float, beams: int, range_m: float
) -> NDArray[np.float64]:
    """As world.lidar.cast."""
    far = range_m / geometry.resolution_m
    walls, wider = pad(occupied, geometry, math.ceil(far) + 2)
    free, cols = ~walls.ravel(), wider.cols
    u, v = (x_m - wider.x0_m) / geometry.resolution_m, (y_m - wider.y0_m) / geometry.resolution_m
    angles = 2.0 * np.pi * np.arange(beams) / beams
    ahead = np.concatenate((np.cos(angles), np.sin(angles)))
    drift = np.concatenate((np.sin(angles), np.cos(angles)))
    never = np.abs(ahead) < 1e-9
    forward = ahead > 0
    per_line = 1.0 / np.where(never, 1.0, np.abs(ahead))
    drift = np.where(never, 0.0, drift * per_line)
    per_line = np.where(never, 10.0 * far, per_line)
    # Every ray keeps at least one crossing, since an empty segment has no minimum.
    counts = np.maximum(np.ceil(far * np.where(never, 0.0, np.abs(ahead))), 1).astype(np.int64)
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    ray = np.repeat(np.arange(len(ahead)), counts)
    line = np.arange(len(ray)) - starts[ray]
    vertical = ray < beams
    step = np.where(forward[ray], line + 1, -line - 1)

    to_first = np.where(np.arange(2 * beams) < beams, u - math.floor(u), v - math.floor(v))
    np.subtract(1.0, to_first, out=to_first, where=forward)
    beside = to_first * drift + np.where(np.arange(2 * beams) < beams, v, u)
    along = (beside[ray] + line * drift[ray]).astype(np.int64)
    cells = np.where(vertical, along * cols + step + math.floor(u), along + (step + math.floor(v)) * cols)
    distance = (to_first * per_line)[ray] + np.where(never[ray], math.inf, line * per_line[ray])
    distance[free.take(cells, mode="clip")] = far
    nearest = np.minimum.reduceat(distance, starts)
    nearest = np.minimum(nearest, far)
    ranges: NDArray[np.float64] = np.minimum(nearest[:beams], nearest[beams:]) * geometry.resolution_m
    return np.minimum(ranges, range_m)
