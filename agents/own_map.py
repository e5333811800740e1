"""A robot's own map: the MS's map as it came down, and what the own lidar saw and the MS's map does not contain yet.

What hits and misses make of a cell stands in agents/evidence.py.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import _cells, _floor
from agents.config import RobotConfig
from agents.evidence import SCANS_OF_A_PLACE, SensorModel
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

_NONE: Final = np.zeros(0, np.int64)


def frontiers(states: NDArray[np.int8], geometry: GridGeometry) -> NDArray[np.int64]:
    """Flat indices, ascending, of the cells of a map that are known free and have an unknown one beside them."""
    grid = states.reshape(geometry.rows, geometry.cols)
    unknown = grid == UNKNOWN
    beside = np.zeros_like(unknown)
    beside[1:] |= unknown[:-1]
    beside[:-1] |= unknown[1:]
    beside[:, 1:] |= unknown[:, :-1]
    beside[:, :-1] |= unknown[:, 1:]
    beside &= grid == FREE
    return np.flatnonzero(beside)


class OwnMap:
    """Cells in {UNKNOWN, FREE, OCCUPIED}, flat, in the grid that all maps of the run share."""

    def __init__(self, config: RobotConfig) -> None:
        self.geometry = config.geometry
        self._sensors = SensorModel(config)
        self._range_m = config.lidar_range_m
        self._beams = config.lidar_beams
        self._beams_per_radian = config.lidar_beams / (2.0 * math.pi)
        angles = 2.0 * math.pi * np.arange(config.lidar_beams) / config.lidar_beams
        self._cos, self._sin = np.cos(angles), np.sin(angles)
        self.cells = self.geometry.blank(config.safety_zone_m)
        self._odds = self._sensors.first_odds()
        """Of each cell, as the MS has told."""
        self._scores: NDArray[np.int32] = self._odds.astype(np.int32)
        """Of each cell, by those odds and the own reports that they do not contain."""
        blocks = [math.ceil(n / _cells.BLOCK) for n in (self.geometry.rows, self.geometry.cols)]
        self._opened = np.ones(blocks, np.uint8)
        """Of each block of cells, whether a miss of any of them may count."""
        self._place_m = (0.0, 0.0)
        """Where the robot has been scanning since it last moved on ..."""
        self._scans_here = 0
        """... and how often."""
        self.version = 0
        """Rises with every change."""
        self.reverted = 0
        """How many times a cell that was known to be free was so no longer."""
        self._changed = [np.flatnonzero(self.cells == FREE)]
        self._is_frontier = np.zeros(self.geometry.size, np.uint8)
        """Of each cell, when somebody last asked for the frontiers ..."""
        self._frontiers = _NONE
        """... which were these, ..."""
        self._frontiers_seen = 0
        """... with the changes up to this mark."""

    def integrate(
        self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8], int]:
        """Integrate a scan taken at a place.

        Returns:
            The cells on which it is evidence that counts, each once; FREE for a miss or OCCUPIED for a hit; and how
            many cells were unknown and are free now.

        Raises:
            ValueError: the scan has not the configured number of beams.
        """
        if len(ranges_m) != self._beams:
            raise ValueError(f"a scan has {self._beams} ranges, not {len(ranges_m)}")
        if not self._counts_here(x_m, y_m):
            return _NONE, self.cells[:0], 0
        hit = self._hit(x_m, y_m, ranges_m)
        missed, freed = self._weigh(self._missed(x_m, y_m, ranges_m, hit), -self._sensors.miss)
        hit, _ = self._weigh(hit, self._sensors.worth)
        values = np.zeros(len(missed) + len(hit), np.int8)
        values[len(missed) :] = OCCUPIED
        return np.concatenate((missed, hit)), values, int(np.count_nonzero(self.cells[freed] == FREE))

    def _counts_here(self, x_m: float, y_m: float) -> bool:
        """Whether a scan from here is evidence: with noise, only a few from one place are."""
        if self._sensors.exact:
            return True
        if self._scans_here == 0 or math.dist(self._place_m, (x_m, y_m)) > self._sensors.place_m:
            self._place_m, self._scans_here = (x_m, y_m), 0
        self._scans_here += 1
        return self._scans_here <= SCANS_OF_A_PLACE

    def _missed(
        self, x_m: float, y_m: float, ranges_m: NDArray[np.float64], hit: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Cells, besides those that it hit, that a scan shows to be free, where that counts."""
        g = self.geometry
        return _cells.passed(
            self._scores, self._opened, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m,
            ranges_m, self._beams_per_radian, hit, not self._sensors.exact,
            self._sensors.miss, self._sensors.worth, self._sensors.settled,
        )  # fmt: skip

    def _hit(self, x_m: float, y_m: float, ranges_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cells, ascending, that a scan shows to be wall."""
        g = self.geometry
        cells = _cells.met(
            g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m,
            ranges_m, self._cos, self._sin, self._range_m, self._sensors.into_wall_m,
        )  # fmt: skip
        ends = np.array(sorted(set(cells.tolist())), np.int64)
        if self._sensors.exact:
            return ends
        return _cells.unreached(
            ends, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m, ranges_m, self._beams_per_radian
        )

    def _weigh(self, cells: NDArray[np.int64], evidence: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Add evidence where it counts; returns the cells where it did, and those whose state changed."""
        counted, changed, lost = _cells.weigh(
            self._scores, self.cells, self._opened, self.geometry.cols,
            cells, evidence, self._sensors.worth, self._sensors.settled,
        )  # fmt: skip
        self._note(changed, lost)
        return counted, changed

    def apply(self, cells: NDArray[np.uint32], odds: NDArray[np.int8]) -> None:
        """Take over the odds of cells from the MS (agents/evidence.py).

        Raises:
            IndexError: a cell lies outside the grid.
        """
        changed = _cells.apply(
            self._odds, self._scores, self.cells, self._opened, self.geometry.cols, cells, odds, self._sensors.worth
        )
        self._note(*changed)

    def forget(self, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        """Drop the evidence of an own report, since the MS's odds contain it."""
        changed = _cells.forget(
            self._scores, self.cells, self._opened, self.geometry.cols,
            cells, values, self._sensors.miss, self._sensors.worth,
        )  # fmt: skip
        self._note(*changed)

    def _note(self, changed: NDArray[np.int64], lost: int) -> None:
        """Note the cells whose state changed, and how many of them are known to be free no longer."""
        if changed.size:
            self._changed.append(changed)
            self.version += 1
            self.reverted += lost

    def changes(self, since: int) -> tuple[NDArray[np.int64], int]:
        """Cells that changed since a mark (0 at first), in any order, some perhaps twice; and the next mark."""
        new = self._changed[since:]
        return np.concatenate(new) if new else _NONE, len(self._changed)

    def is_frontier(self, index: int) -> bool:
        """Whether a cell is known free and one of its four neighbors unknown; outside of the grid counts as known."""
        return _floor.is_frontier(self.cells, self.geometry.cols, index)

    def frontiers(self) -> NDArray[np.int64]:
        """Flat indices, ascending, of all frontier cells; only what changed is looked at."""
        changed, self._frontiers_seen = self.changes(self._frontiers_seen)
        if changed.size:
            new = _floor.new_frontiers(changed, self.cells, self.geometry.cols, self._is_frontier)
            left = self._frontiers[self._is_frontier[self._frontiers] != 0]
            self._frontiers = np.sort(np.concatenate((left, new)))
        return self._frontiers

    def clear_line(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> bool:
        """Whether every cell on a segment is known free."""
        return self.obstacles(x0_m, y0_m, x1_m, y1_m) == 0

    def obstacles(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> int:
        """Number of contiguous runs of cells on a segment that are not known to be free; 1 if it leaves the grid.

        Between two crossings of grid lines lies one cell.
        """
        g = self.geometry
        u0, v0 = (x0_m - g.x0_m) / g.resolution_m, (y0_m - g.y0_m) / g.resolution_m
        du, dv = (x1_m - x0_m) / g.resolution_m, (y1_m - y0_m) / g.resolution_m
        # A peer may announce any location, and noise may put a robot outside of the grid.
        if not (0.0 <= u0 < g.cols and 0.0 <= v0 < g.rows and 0.0 <= u0 + du < g.cols and 0.0 <= v0 + dv < g.rows):
            return 1
        return _floor.obstacles(self.cells, g.cols, u0, v0, du, dv)
