"""Real robots on a floor plan that they know, joined by a disk radio; a test puts them somewhere, or lets them walk."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence

import numpy as np

from agents.config import RobotConfig, Rules
from agents.dsdv import Router
from agents.messages import Update
from agents.robot import Robot
from agents.vds import Vds
from medium.messages import BROADCAST, Inbox, Reception
from tests.helpers.routing_field import power_dbm
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.messages import Motion, Sense
from world.terms import NOBODY, STATION, TICK_S, Cls, Place

Rectangle = tuple[float, float, float, float]
"""x0, y0, x1, y1 in metres."""

GEOMETRY = GridGeometry(80, 120, 0.5)
RADIUS_M = 10.0
"""r_t; so r_in is 8 m, r_out 9 m, and rule c takes neighbors within 6.5 m."""
BEAMS = 180
RANGE_M = 8.0
_MOST_TICKS = 3000


def config_of(node: int, station_m: Place, rules: Rules) -> RobotConfig:
    """Exact sensors; the safety zone is the station's own cell."""
    return RobotConfig(
        node, 1, GEOMETRY, station_m, (*station_m, *station_m), RADIUS_M, RANGE_M, BEAMS, 0.0, 40.0, 3.0, rules=rules
    )


class Team:
    """The MS and robots with the paper's policy. They hear each other's real updates, a tick later."""

    def __init__(
        self,
        free: Sequence[Rectangle],
        at: Mapping[int, Place],
        *,
        dark: Sequence[Rectangle] = (),
        rules: Rules | None = None,
    ) -> None:
        """Put nodes at their places; node STATION is the MS.

        Args:
            free: the floor, which all robots know; all else they know to be wall.
            at: places by node.
            dark: what they do not know, for all that `free` says.
            rules: of the robots.
        """
        rules = rules or Rules()
        self.at = dict(at)
        self.tick = 0
        self.silent: set[int] = set()
        """Nodes of which nobody hears anything."""
        self.motions: dict[int, Motion] = {}
        self._station = Router(config_of(STATION, at[STATION], rules), random.Random(0), 0)
        robots = [node for node in sorted(at) if node != STATION]
        self.robots = {
            node: Robot(config_of(node, at[STATION], rules), Vds, random.Random(node), 0, 0) for node in robots
        }
        self._heard: dict[int, list[Reception]] = {node: [] for node in sorted(at)}
        known = np.full(GEOMETRY.size, 1, np.int8)
        for rectangle in free:
            known[self.inside(rectangle)] = -1
        for rectangle in dark:
            known[self.inside(rectangle)] = 0
        cells = np.flatnonzero(known)
        for robot in self.robots.values():
            robot.body.map.apply(cells.astype(np.uint32), known[cells])

    @staticmethod
    def inside(rectangle: Rectangle) -> np.ndarray:
        """Cells whose centers lie in a rectangle."""
        x0, y0, x1, y1 = rectangle
        x, y = GEOMETRY.centers(np.arange(GEOMETRY.size)).T
        return np.flatnonzero((x > x0) & (x < x1) & (y > y0) & (y < y1))

    def see_wall(self, rectangle: Rectangle) -> None:
        """All robots come to know that what they do not know of a rectangle is wall."""
        self._see(rectangle, 1, OCCUPIED)

    def see_floor(self, rectangle: Rectangle) -> None:
        """The same, and it is floor."""
        self._see(rectangle, -1, FREE)

    def _see(self, rectangle: Rectangle, odds: int, state: int) -> None:
        for robot in self.robots.values():
            cells = self.inside(rectangle)
            cells = cells[robot.body.map.cells[cells] == UNKNOWN]
            robot.body.map.apply(cells.astype(np.uint32), np.full(len(cells), odds, np.int8))
            assert (robot.body.map.cells[cells] == state).all()

    def policy(self, node: int) -> Vds:
        """What decides for a robot."""
        return self.robots[node].policy

    def cls(self, node: int) -> Cls:
        """The class that a robot gave itself at the last tick."""
        return self.policy(node).classifier.cls

    def nms(self, node: int) -> int:
        """A robot's next hop to the MS."""
        return self.robots[node].body.router.ms.nms

    def speed_m_s(self, node: int) -> float:
        """At which a robot wants to move."""
        return math.hypot(*self.velocity_m_s(node))

    def velocity_m_s(self, node: int) -> tuple[float, float]:
        """That a robot wants."""
        return self.motions[node].vx_m_s, self.motions[node].vy_m_s

    def step(self, *, walking: Sequence[int] = ()) -> None:
        """One tick; robots that are not `walking` stay where they are, whatever they want."""
        assert self.tick < _MOST_TICKS, "what the test waits for never comes"
        heard: dict[int, list[Reception]] = {node: [] for node in self._heard}
        for node in heard:
            if node == STATION:
                self._send(heard, STATION, self._station_update())
                continue
            inbox = Inbox(self.tick, tuple(self._heard[node])) if self.tick else None
            sense = Sense(self.tick, self.tick == 0, 0, *self.at[node])
            frames, self.motions[node] = self.robots[node].step(sense, inbox)
            for dst, payload in frames:
                if dst == BROADCAST:
                    self._send(heard, node, payload)
        for node in walking:
            x, y = self.at[node]
            vx, vy = self.velocity_m_s(node)
            self.at[node] = x + vx * TICK_S, y + vy * TICK_S
        self._heard = heard
        self.tick += 1

    def run(self, ticks: int, *, walking: Sequence[int] = ()) -> None:
        """Many ticks."""
        for _ in range(ticks):
            self.step(walking=walking)

    def _station_update(self) -> bytes:
        self._station.step(self.tick, self._heard[STATION])
        here = self.at[STATION]
        self._station.announce_self(self.tick, here, Cls.RR, here)
        return Update(NOBODY, NOBODY, 0, self._station.table.advertised(), b"").encode()

    def _send(self, heard: dict[int, list[Reception]], src: int, payload: bytes) -> None:
        if src in self.silent:
            return
        for node in heard:
            gap_m = math.dist(self.at[src], self.at[node])
            if node != src and gap_m <= RADIUS_M:
                heard[node].append((src, power_dbm(gap_m), payload))
