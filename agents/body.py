"""What a policy reads and drives: the robot's pose, map, planner and router. All of it was sensed or heard."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

from agents.config import RobotConfig
from agents.dsdv import Router
from agents.found_bodies import Found
from agents.ms_distance import MsDistance
from agents.own_map import OwnMap
from agents.planner import Planner
from world.terms import NOBODY, Cls, Mode, Place


@dataclass(slots=True, init=False)
class Action:
    """A policy's decision for one tick."""

    velocity_m_s: tuple[float, float]
    mode: Mode
    cls: Cls
    target_m: Place
    """Announced to all."""
    msr: int
    hold: int
    """Announced to neighbors."""
    need: bool
    """Announced to all."""

    def __init__(
        self,
        velocity_m_s: tuple[float, float],
        mode: Mode,
        cls: Cls,
        target_m: Place,
        msr: int = NOBODY,
        hold: int = NOBODY,
        need: bool = False,
    ) -> None:
        self.velocity_m_s = velocity_m_s
        self.mode = mode
        self.cls = cls
        self.target_m = target_m
        self.msr = msr
        self.hold = hold
        self.need = need


class Body:
    """The parts of one robot that its policy reads and drives."""

    def __init__(self, config: RobotConfig, rng: random.Random, quiet_until: int) -> None:
        self.config = config
        self.rng = rng
        self.router = Router(config, rng, quiet_until)
        self.map = OwnMap(config)
        self.found = Found(config.geometry, 2.0 * config.body_radius_m)
        """Silent bodies that the robot ran into."""
        self.planner = Planner(self.map, self.found)
        self._from_ms = MsDistance(self.map, self.planner, config.station_m)
        self.tick = 0
        self.at: Place = config.station_m

    def ms_distance(self, places_m: Sequence[Place]) -> list[float]:
        """Path lengths in metres from the MS to places, as of this tick."""
        return self._from_ms.lengths_m(self.tick, places_m)
