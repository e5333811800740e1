"""An exact lidar: where each beam first meets a wall of an occupancy grid.

A beam can enter a cell only where it crosses a grid line. All crossings of all beams within range are laid out once,
flat and beam by beam; a scan then only shifts them to the place of the robot, looks the entered cells up, and takes
the nearest wall of each beam.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from world.compiled import kernels
from world.geometry import pad
from world.grid import GridGeometry

__all__ = ["Caster", "cast"]

_PARALLEL = 1e-9
"""A beam whose direction cosine is below this never crosses the lines of that axis within any range."""


class _Crossings:
    """Crossings of every beam with the grid lines of both axes, in units of cells.

    A "ray" is a beam seen along one axis: rays 0 .. beams - 1 cross vertical lines, the rest horizontal ones.
    Its crossings are contiguous, from `starts`; those of vertical lines fill the flat arrays up to `split`.
    """

    def __init__(self, angles: NDArray[np.float64], range_cells: float, cols: int) -> None:
        ahead = np.concatenate((np.cos(angles), np.sin(angles)))
        drift = np.concatenate((np.sin(angles), np.cos(angles)))
        never = np.abs(ahead) < _PARALLEL
        self.forward = ahead > 0
        per_line = 1.0 / np.where(never, 1.0, np.abs(ahead))
        self.per_line = np.where(never, 10.0 * range_cells, per_line)
        """(rays,) distance from one line to the next."""
        self.drift = np.where(never, 0.0, drift * per_line)
        """(rays,) how far the beam moves along a line from one to the next."""
        # Every ray keeps at least one crossing, since an empty segment has no minimum.
        counts = np.maximum(np.ceil(range_cells * np.where(never, 0.0, np.abs(ahead))), 1).astype(np.int64)
        self.counts = counts
        self.never = never
        self.starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
        self.ray = np.repeat(np.arange(len(ahead)), counts)
        self.split = int(counts[: len(angles)].sum())
        line = np.arange(len(self.ray)) - self.starts[self.ray]
        vertical = self.ray < len(angles)
        self.line_drift = line * self.drift[self.ray]
        self.line_distance = np.where(never[self.ray], math.inf, line * self.per_line[self.ray])
        self.stride = np.where(vertical, cols, 1)
        """Flat step of one cell along the line."""
        ahead_cells = np.where(self.forward[self.ray], line + 1, -line - 1)
        self.entered = ahead_cells * np.where(vertical, 1, cols)
        """Flat step from the robot's column (row) to the one entered."""


class Caster:
    """Casts scans of one kind in one floor plan. Beam i points at angle 2 pi i / beams."""

    def __init__(self, occupied: NDArray[np.bool_], geometry: GridGeometry, beams: int, range_m: float) -> None:
        self._range_m = range_m
        self._resolution_m = geometry.resolution_m
        self._far = range_m / geometry.resolution_m
        walls, wider = pad(occupied, geometry, math.ceil(self._far) + 2)
        self._free = ~walls.ravel()
        self._cols = wider.cols
        self._x0_m, self._y0_m = wider.x0_m, wider.y0_m
        self._beams = beams
        self._crossings = _Crossings(2.0 * np.pi * np.arange(beams) / beams, self._far, wider.cols)

    def cast(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Ranges of one scan from a place inside the grid.

        Returns:
            (beams,) metres to the surface of the first wall; exactly the lidar's range where there is none within it.
        """
        lines, beams = self._crossings, self._beams
        u, v = (x_m - self._x0_m) / self._resolution_m, (y_m - self._y0_m) / self._resolution_m
        if kernels is not None:
            ranges: NDArray[np.float64] = kernels.cast(
                self._free, self._cols, u, v, self._far,
                lines.forward, lines.per_line, lines.drift, lines.counts, lines.never,
                self._resolution_m, self._range_m,
            )  # fmt: skip
            return ranges
        col, row = math.floor(u), math.floor(v)
        to_first = np.empty(2 * beams)
        to_first[:beams] = u - col
        to_first[beams:] = v - row
        np.subtract(1.0, to_first, out=to_first, where=lines.forward)
        beside = to_first * lines.drift
        beside[:beams] += v
        beside[beams:] += u
        cells = (beside.take(lines.ray) + lines.line_drift).astype(np.int64)
        cells *= lines.stride
        cells += lines.entered
        cells[: lines.split] += col
        cells[lines.split :] += row * self._cols
        to_first *= lines.per_line
        distance = to_first.take(lines.ray)
        distance += lines.line_distance
        # The first crossing of a beam almost along the lines may lie beyond the padding: any answer will do there,
        # since it is beyond the range too.
        np.copyto(distance, self._far, where=self._free.take(cells, mode="clip"))
        nearest = np.minimum.reduceat(distance, lines.starts)
        return np.minimum(np.minimum(nearest[:beams], nearest[beams:]) * self._resolution_m, self._range_m)


def cast(
    occupied: NDArray[np.bool_], geometry: GridGeometry, x_m: float, y_m: float, beams: int, range_m: float
) -> NDArray[np.float64]:
    """Ranges (beams,) of a single scan; whoever scans often keeps a `Caster`."""
    return Caster(occupied, geometry, beams, range_m).cast(x_m, y_m)
