"""Doorways: a relay that waits in a narrow place steps on to the nearest wide one from which its links hold.

A place is narrow if, on a line through it, walls are nearer to each other than `door_width_m`. The links are those to
the NMS and to the children, as the own map predicts them (predicted_links.py). The relay stays there for a while even
if its policy would walk on, since that leads back into the door.
"""

from __future__ import annotations

import math
from typing import Final

from agents.body import Action, Body
from agents.config import GivingWay
from agents.predicted_links import PredictedLinks
from world.terms import NOBODY, TICK_S, Cls, Mode, Place, tick_of

_STEP_M: Final = 0.25
"""Places are looked at so far apart, and walls are measured so exactly."""
_LOOK_TICKS: Final = 10
_AXES: Final = tuple((math.cos(math.pi * k / 4), math.sin(math.pi * k / 4)) for k in range(4))


class Doorways:
    """The doors of one robot."""

    def __init__(self, body: Body, rules: GivingWay, apart_m: float) -> None:
        self._body = body
        self._rules = rules
        self._apart_m = apart_m
        self._links = PredictedLinks(body, predict=True)
        self._spot: Place | None = None
        self._until = -1

    def velocity(self, action: Action) -> Place:
        """The policy's velocity, or that to a wide place for a relay that waits in a narrow one."""
        tick, at = self._body.tick, self._body.at
        if action.cls is not Cls.RR or action.mode not in (Mode.WAIT, Mode.WALK):
            self._spot = None
            return action.velocity_m_s
        stands = math.hypot(*action.velocity_m_s) < 0.01
        if self._spot is not None and (tick >= self._until or not self._holds(self._spot)):
            self._spot = None
        if self._spot is None and stands and (tick + self._body.config.node) % _LOOK_TICKS == 0 and self.narrow(at):
            self._spot = self._wide_place()
            self._until = tick + tick_of(self._rules.stay_s)
        if self._spot is None:
            return action.velocity_m_s
        away = math.dist(at, self._spot)
        if away < 0.02:
            return 0.0, 0.0
        speed = min(self._body.config.rules.moving.speed_m_s, away / TICK_S)
        return speed * (self._spot[0] - at[0]) / away, speed * (self._spot[1] - at[1]) / away

    def narrow(self, place: Place) -> bool:
        """Whether walls, or unknown cells, leave less than the width of a door at a place."""
        width = self._rules.door_width_m
        return any(self._free_m(place, x, y) + self._free_m(place, -x, -y) < width for x, y in _AXES)

    def _free_m(self, place: Place, x: float, y: float) -> float:
        """How far it is free from a place in a direction, up to the width of a door."""
        free = 0.0
        while free < self._rules.door_width_m:
            there = free + _STEP_M
            if not self._body.map.clear_line(*place, place[0] + there * x, place[1] + there * y):
                return free
            free = there
        return free

    def _holds(self, place: Place) -> bool:
        """Whether the links to the NMS and to the children hold at a place, or are no worse there."""
        router = self._body.router
        nodes = [*router.inv] if router.ms.nms == NOBODY else [router.ms.nms, *router.inv]
        for node in nodes:
            then = self._links.predicted_m(place, node)
            if then > router.ms.r_in_m and then > self._links.predicted_m(self._body.at, node):
                return False
        return True

    def _wide_place(self) -> Place | None:
        """The nearest place that is not narrow, in a straight line, from which all links hold."""
        (x, y), g = self._body.at, self._body.map.geometry
        steps = int(self._rules.step_on_m / _STEP_M)
        around = [(dx, dy) for dx in range(-steps, steps + 1) for dy in range(-steps, steps + 1)]
        around.sort(key=lambda d: (d[0] * d[0] + d[1] * d[1], d))
        for dx, dy in around:
            place = g.center(g.index(x + dx * _STEP_M, y + dy * _STEP_M))
            if dx * dx + dy * dy > steps * steps or not self._body.map.clear_line(x, y, *place):
                continue
            if not self.narrow(place) and self._holds(place):
                return place
        return None
