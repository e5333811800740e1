"""Senses of nodes: their pose, and when a scan is due, lidar ranges and victims in sight."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from world.config import WorldConfig
from world.grid.lines import line_of_sight, pad
from world.lidar import Caster
from world.messages import Sense
from world.roster import Roster
from world.seeds import Stream, counted
from world.terms import STATION

__all__ = ["Senses"]

Sightings: TypeAlias = tuple[tuple[int, float, float], ...]
"""(victim id, x, y) of each"""


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
        """Senses of `nodes`, ascending; `xy_m` is (robots + 1, 2), the true positions.

        A robot scans at its first tick and whenever (tick + node) is a multiple of the lidar's interval.
        """
        true: list[list[float]] = xy_m.tolist()
        places = true
        if self._pose_noise_m > 0:
            places = true.copy()
            for node in (n for n in nodes if n != STATION):
                noise = counted(self._seed, Stream.POSE, node, tick).normal(0.0, self._pose_noise_m, 2)
                places[node] = (xy_m[node] + noise).tolist()
        interval = self._lidar.interval_ticks
        due = [n for n in nodes if n != STATION and ((tick + n) % interval == 0 or roster.first(n))]
        victims = self._victims_seen(due, true)
        senses = {}
        for node in nodes:
            x, y = places[node]
            first, incarnation = roster.first(node), roster.incarnation(node)
            if node in victims:
                senses[node] = Sense(tick, first, incarnation, x, y, self._scan(tick, node, *true[node]), victims[node])
            else:
                senses[node] = Sense(tick, first, incarnation, x, y)
        return senses

    def _scan(self, tick: int, node: int, x_m: float, y_m: float) -> NDArray[np.float64]:
        lidar = self._lidar
        ranges = self._caster.cast(x_m, y_m)
        if lidar.noise_m > 0:
            noisy = ranges + counted(self._seed, Stream.LIDAR, node, tick).normal(0.0, lidar.noise_m, len(ranges))
            ranges = np.where(ranges < lidar.range_m, noisy.clip(0.0, lidar.range_m), ranges)
        return ranges

    def _victims_seen(self, robots: list[int], places_m: list[list[float]]) -> dict[int, Sightings]:
        """Victims within lidar range and line of sight of each of some robots; `places_m` by node."""
        seen: dict[int, Sightings] = dict.fromkeys(robots, ())
        square = self._lidar.range_m**2
        for robot in robots:
            at_x, at_y = places_m[robot]
            for victim, (x, y) in enumerate(self._victims):
                near = (at_x - x) * (at_x - x) + (at_y - y) * (at_y - y) <= square
                if near and line_of_sight(self._walls, self._geometry, (at_x, at_y), (x, y)):
                    seen[robot] += ((victim, x, y),)
        return seen
