"""What nodes sense: their pose, and at their turns a lidar scan and the victims in sight."""

from __future__ import annotations

from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from world.config import WorldConfig
from world.geometry import pad, walls_crossed
from world.lidar import Caster
from world.messages import STATION, Sense
from world.roster import Roster

__all__ = ["Purpose", "Senses", "seeded"]

Sightings: TypeAlias = tuple[tuple[int, float, float], ...]
"""(victim id, x, y) of each"""


class Purpose(IntEnum):
    """What the world draws random numbers for; none of them depends on another."""

    LIDAR = 0
    POSE = 1
    CHOICE = 2
    """Whom a fault with target `random` hits."""


def seeded(seed: int, purpose: Purpose) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int(purpose)])))


class Senses:
    """The sensors of all nodes of a run."""

    def __init__(self, config: WorldConfig) -> None:
        self._lidar = config.lidar
        self._pose_noise_m = config.pose_noise_m
        self._caster = Caster(config.occupied, config.geometry, config.lidar.beams, config.lidar.range_m)
        self._walls, self._geometry = pad(config.occupied, config.geometry)
        self._victims = [(float(x), float(y)) for x, y in config.victims_m]
        self._seed = config.seed

    def at(self, tick: int, nodes: list[int], xy_m: NDArray[np.float64], roster: Roster) -> dict[int, Sense]:
        """Senses of `nodes`, ascending; `xy_m` is (robots + 1, 2), where everybody truly is.

        A robot scans at its first tick and whenever (tick + node) is a multiple of the lidar's interval.
        """
        places = xy_m.tolist()
        if self._pose_noise_m > 0:
            for node in (n for n in nodes if n != STATION):
                noise = self._generator(Purpose.POSE, tick, node).normal(0.0, self._pose_noise_m, 2)
                places[node] = (xy_m[node] + noise).tolist()
        interval = self._lidar.interval_ticks
        due = [n for n in nodes if n != STATION and ((tick + n) % interval == 0 or roster.first(n))]
        victims = self._victims_seen(due, xy_m)
        senses = {}
        for node in nodes:
            x, y = places[node]
            first, incarnation = roster.first(node), roster.incarnation(node)
            if node in victims:
                senses[node] = Sense(tick, first, incarnation, x, y, self._scan(tick, node, xy_m), victims[node])
            else:
                senses[node] = Sense(tick, first, incarnation, x, y)
        return senses

    def _generator(self, purpose: Purpose, tick: int, node: int) -> np.random.Generator:
        """One for each node and tick: who else is there, and who was, changes nobody's noise (Salmon et al. 2011)."""
        return np.random.Generator(np.random.Philox(counter=[0, 0, node, tick], key=[self._seed, int(purpose)]))

    def _scan(self, tick: int, node: int, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        lidar = self._lidar
        ranges = self._caster.cast(*xy_m[node].tolist())
        if lidar.noise_m > 0:
            noisy = ranges + self._generator(Purpose.LIDAR, tick, node).normal(0.0, lidar.noise_m, len(ranges))
            ranges = np.where(ranges < lidar.range_m, noisy.clip(0.0, lidar.range_m), ranges)
        return ranges

    def _victims_seen(self, robots: list[int], xy_m: NDArray[np.float64]) -> dict[int, Sightings]:
        """Victims within lidar range and line of sight of each of some robots."""
        seen: dict[int, Sightings] = dict.fromkeys(robots, ())
        if not robots or not len(self._victims):
            return seen
        # A few robots and victims: a loop finds who is near sooner than numpy does.
        square = self._lidar.range_m**2
        near = [
            (robot, victim, x, y)
            for robot, (at_x, at_y) in zip(robots, xy_m[robots].tolist(), strict=True)
            for victim, (x, y) in enumerate(self._victims)
            if (at_x - x) * (at_x - x) + (at_y - y) * (at_y - y) <= square
        ]
        if near:
            places = np.array([(x, y) for _, _, x, y in near])
            crossed = walls_crossed(self._walls, self._geometry, xy_m[[robot for robot, *_ in near]], places)
            for (robot, victim, x, y), walls in zip(near, crossed.tolist(), strict=True):
                if not walls:
                    seen[robot] += ((victim, x, y),)
        return seen
