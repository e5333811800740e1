"""Motion of robots: straight, at their top speed at most, and never into a wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.grid.lines import walls_crossed
from world.terms import TICK_S

__all__ = ["move"]


def move(
    walls: NDArray[np.bool_],
    geometry: GridGeometry,
    xy_m: NDArray[np.float64],
    velocities_m_s: list[tuple[float, float]],
    top_speed_m_s: float,
) -> NDArray[np.float64]:
    """Positions a tick later. A robot that a wall stops slides along x, else along y, else stays.

    Args:
        walls: (rows, cols), with a closed frame of walls.
        geometry: of `walls`.
        xy_m: (n, 2) places, each in a free cell.
        velocities_m_s: n pairs, wanted.
        top_speed_m_s: longer velocities are shortened to this.

    Returns:
        (n, 2) places, each in a free cell, reached without crossing a wall.
    """
    x0_m, y0_m, resolution_m = geometry.x0_m, geometry.y0_m, geometry.resolution_m
    steps: list[tuple[float, float]] = []
    places: list[tuple[float, float]] = []
    leaving: list[int] = []
    clear = True
    # Few robots leave their cell within a tick, and fewer meet a wall: a loop finds that out sooner than numpy does.
    for k, ((x, y), (vx, vy)) in enumerate(zip(xy_m.tolist(), velocities_m_s, strict=True)):
        step_x, step_y = vx * TICK_S, vy * TICK_S
        speed = math.sqrt(vx * vx + vy * vy)
        if speed > top_speed_m_s:
            step_x *= top_speed_m_s / speed
            step_y *= top_speed_m_s / speed
        to_x, to_y = x + step_x, y + step_y
        # The same arithmetic as in `_cells`.
        col, row = math.floor((x - x0_m) / resolution_m), math.floor((y - y0_m) / resolution_m)
        to_col, to_row = math.floor((to_x - x0_m) / resolution_m), math.floor((to_y - y0_m) / resolution_m)
        if to_col != col or to_row != row:
            leaving.append(k)
            # Between two neighboring cells lies no third.
            clear = clear and abs(to_col - col) + abs(to_row - row) == 1 and not walls[to_row, to_col]
        steps.append((step_x, step_y))
        places.append((to_x, to_y))
    wanted = np.array(places, np.float64).reshape(-1, 2)
    if not clear:
        step = np.array(steps, np.float64)
        crossing = np.array(leaving)
        stopped = crossing[_blocked(walls, geometry, xy_m[crossing], wanted[crossing])]
        for axis in (1, 0):
            if len(stopped):
                wanted[stopped] = xy_m[stopped] + step[stopped]
                wanted[stopped, axis] = xy_m[stopped, axis]
                stopped = stopped[_blocked(walls, geometry, xy_m[stopped], wanted[stopped])]
        wanted[stopped] = xy_m[stopped]
    return wanted


def _cells(geometry: GridGeometry, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """(..., 2) column and row, by the same arithmetic as `walls_crossed`, so that the two never disagree."""
    return np.floor((xy_m - (geometry.x0_m, geometry.y0_m)) / geometry.resolution_m).astype(np.int64)


def _blocked(
    walls: NDArray[np.bool_], geometry: GridGeometry, a_xy: NDArray[np.float64], b_xy: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) whether a wall lies between a, which is free, and b."""
    there = _cells(geometry, b_xy)
    away = np.abs(there - _cells(geometry, a_xy)).sum(axis=1)
    if away.max() <= 1:  # between two neighboring cells lies no third
        return walls[there[:, 1], there[:, 0]]
    return walls_crossed(walls, geometry, a_xy, b_xy) > 0
