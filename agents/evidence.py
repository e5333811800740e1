"""What makes a cell of a map free or wall: hits and misses, counted (Moravec & Elfes 1985; Thrun et al. 2005, ch. 9).

A scan *misses* a cell if the beam that points at its center goes farther, and *hits* it if a beam ends in it. Nobody
ever forgets a hit or a miss, so sums do not depend on the order of scans. What they say is read from the sums:

    score    worth x hits - miss x misses
    odds     the score, at most `settled` each way; above 0 in units of a hit
    state    FREE if the score is below 0, OCCUPIED above, UNKNOWN at 0

Evidence that does not change the odds of a cell, as the robot knows them, is neither counted nor reported. So a cell is
*settled* once the odds have reached their limit, and costs nothing more until a scan contradicts it.

With exact sensors no beam ends in a free cell. So a cell in which one ends is hit, although another beam that points
nearly at its center may pass its corner; one hit outweighs all misses, and one observation settles a cell.

With noise, a beam often ends before its wall, and what is seen from one place is wrong in the same way every time. So
both beams beside the center of a cell must agree, or the scan says nothing of it, and a robot that stands still does
not repeat itself. As long as the noise is small against a cell, a wall is hardly ever missed, but cells before it are
often hit; then a miss outweighs a hit.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from world.grid import FREE, OCCUPIED, UNKNOWN

_ALL: Final = 1 << 15
"""Worth of a hit by an exact sensor, in misses: more than any robot reports of a cell."""
_ROUNDING_M: Final = 1e-9
"""How far behind the end of a beam the wall's cell is looked up by exact sensors."""
_SETTLED: Final = 6
"""Odds at which a cell is settled, if the sensors are noisy."""
SCANS_OF_A_PLACE: Final = 2
"""So many scans of a robot that stands still count, if the sensors are noisy."""


class SensorModel:
    """How much a hit is worth, by the noise of lidar and pose, which a robot knows as it knows the lidar's range."""

    def __init__(self, config: RobotConfig) -> None:
        self._config = config
        noise_m = math.hypot(config.lidar_noise_m, config.pose_noise_m)
        self.exact = noise_m == 0.0
        self.worth = _ALL if self.exact else 1
        """Of a hit."""
        self.miss = 3 if 0.0 < noise_m <= 0.5 * config.geometry.resolution_m else 1
        """Worth of a miss."""
        self.settled = 1 if self.exact else _SETTLED
        """Most odds, each way."""
        self.place_m = 0.5 * config.geometry.resolution_m + 2.0 * config.pose_noise_m
        """A robot that seems to have moved no farther stands still."""
        self.into_wall_m = max(_ROUNDING_M, min(noise_m, 0.5 * config.geometry.resolution_m))
        """How far behind the end of a beam its wall is looked for: a standard deviation, but half a cell at most."""

    def first_odds(self) -> NDArray[np.int8]:
        """Odds of all cells (size,) before the first scan, the same with all nodes: the safety zone is settled free."""
        states = self._config.geometry.blank(self._config.safety_zone_m)
        return np.where(states == FREE, np.int8(-self.settled), np.int8(0))

    @staticmethod
    def states(odds: NDArray[np.int8]) -> NDArray[np.int8]:
        """What odds say: FREE, OCCUPIED or UNKNOWN."""
        return np.where(odds < 0, np.int8(FREE), np.where(odds > 0, np.int8(OCCUPIED), np.int8(UNKNOWN)))
