"""Motion of robots: straight, at their top speed at most, and never into a wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.grid.lines import line_of_sight
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
        walls: (rows, cols), with a closed rim of walls.
        geometry: of `walls`.
        xy_m: (n, 2) places, each in a free cell.
        velocities_m_s: n pairs, wanted.
        top_speed_m_s: longer velocities are shortened to this.

    Returns:
        (n, 2) places, each in a free cell, reached without crossing a wall.
    """
    places: list[tuple[float, float]] = []
    for (x, y), (vx, vy) in zip(xy_m.tolist(), velocities_m_s, strict=True):
        step_x, step_y = vx * TICK_S, vy * TICK_S
        speed = math.sqrt(vx * vx + vy * vy)
        if speed > top_speed_m_s:
            step_x *= top_speed_m_s / speed
            step_y *= top_speed_m_s / speed
        wanted = ((x + step_x, y + step_y), (x + step_x, y), (x, y + step_y))
        places.append(next((to for to in wanted if not _blocked(walls, geometry, (x, y), to)), (x, y)))
    return np.array(places, np.float64).reshape(-1, 2)


def _blocked(walls: NDArray[np.bool_], geometry: GridGeometry, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether a wall lies between a, which is free, and b."""
    row, col = geometry.cell(*a)
    to_row, to_col = geometry.cell(*b)
    away = abs(to_row - row) + abs(to_col - col)
    if away == 0:
        return False
    if away == 1:  # between two neighboring cells lies no third
        return bool(walls[to_row, to_col])
    return not line_of_sight(walls, geometry, a, b)
