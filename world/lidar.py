"""An exact lidar: where each beam first meets a wall of an occupancy grid.

A beam can enter a cell only where it crosses a grid line. Where its crossings lie relative to the first one is the same
in every scan, so a scan only shifts them to the place of the robot and looks up the cells that the beam enters.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from world import _lidar
from world.grid import GridGeometry
from world.grid.lines import pad

__all__ = ["Caster", "cast"]

_PARALLEL = 1e-9
"""A beam whose direction cosine is below this never crosses the lines of that axis within any range."""


class Caster:
    """Casts scans of one kind in one floor plan. Beam i points at angle 2 pi i / beams.

    A "ray" is a beam seen along one axis: rays 0 .. beams - 1 cross vertical lines, the others horizontal ones.
    """

    def __init__(self, occupied: NDArray[np.bool_], geometry: GridGeometry, beams: int, range_m: float) -> None:
        self._range_m = range_m
        self._resolution_m = geometry.resolution_m
        self._far = range_m / geometry.resolution_m
        walls, wider = pad(occupied, geometry, math.ceil(self._far) + 2)
        self._free = ~walls.ravel()
        self._cols = wider.cols
        self._x0_m, self._y0_m = wider.x0_m, wider.y0_m
        angles = 2.0 * np.pi * np.arange(beams) / beams
        ahead = np.concatenate((np.cos(angles), np.sin(angles)))
        drift = np.concatenate((np.sin(angles), np.cos(angles)))
        self._never = np.abs(ahead) < _PARALLEL
        self._forward = ahead > 0
        per_line = 1.0 / np.where(self._never, 1.0, np.abs(ahead))
        self._per_line = np.where(self._never, 10.0 * self._far, per_line)
        """(rays,) distance from one line to the next, in cells."""
        self._drift = np.where(self._never, 0.0, drift * per_line)
        """(rays,) how far the beam moves along a line from one to the next, in cells."""
        lines = np.ceil(self._far * np.where(self._never, 0.0, np.abs(ahead)))
        self._counts = np.maximum(lines, 1).astype(np.int64)
        """(rays,) lines within range."""

    def cast(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Ranges of one scan from a place inside the grid.

        Returns:
            (beams,) metres to the surface of the first wall; exactly the lidar's range where there is none within it.
        """
        u, v = (x_m - self._x0_m) / self._resolution_m, (y_m - self._y0_m) / self._resolution_m
        return _lidar.cast(
            self._free, self._cols, u, v, self._far,
            self._forward, self._per_line, self._drift, self._counts, self._never,
            self._resolution_m, self._range_m,
        )  # fmt: skip


def cast(
    occupied: NDArray[np.bool_], geometry: GridGeometry, x_m: float, y_m: float, beams: int, range_m: float
) -> NDArray[np.float64]:
    """Ranges (beams,) of a single scan; whoever scans often keeps a `Caster`."""
    return Caster(occupied, geometry, beams, range_m).cast(x_m, y_m)
