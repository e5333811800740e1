"""What a robot knows of the bodies around it: what neighbors say, and that something holds it up.

Who is held up by no wall of its map and by no neighbor has run into a body that says nothing. Its place is what a robot
that is silent now said last, else a guess: straight ahead.
"""

from __future__ import annotations

import math
from typing import Final

from agents.config import GivingWay
from agents.dsdv import Router
from agents.found_bodies import Found
from agents.own_map import OwnMap
from world.terms import STATION, TICK_S, Place, tick_of

_TOUCH_M: Final = 0.15
"""Two bodies this near may touch: what a robot knows of another is a tick old."""
_SEEN_WITHIN_TICKS: Final = 2
"""A neighbor's velocity is that between two places that it said no farther apart than this."""
_HELD_SHARE: Final = 0.3
"""A robot that comes no farther than this share of its step is held up."""


class Near:
    """Places and velocities of the neighbors that are near, and whether something holds the robot up."""

    def __init__(self, router: Router, found: Found, rules: GivingWay, apart_m: float) -> None:
        self._router = router
        self._found = found
        self._rules = rules
        self._apart_m = apart_m
        self._said: dict[int, tuple[int, Place, Place]] = {}
        """By neighbor: when it said its place, the place, its velocity."""
        self._commanded: tuple[Place, Place] | None = None
        """Place and velocity of the last tick."""
        self.held_ticks = 0
        """For how long the robot has hardly moved though it wanted to."""

    def look(self, tick: int, at: Place, within_m: float) -> list[tuple[int, Place, Place]]:
        """(id, place now, velocity) of each neighbor within a distance, ascending by id."""
        near = []
        for node, neighbor in sorted(self._router.neighbors.by_id.items()):
            if node == STATION or self._router.neighbors.silent(node, tick):
                self._said.pop(node, None)
                continue
            place, said = self._router.table.location_m(node), self._said.get(node)
            heard = neighbor.heard_tick
            if said is None or heard > said[0]:
                velocity = 0.0, 0.0
                if said is not None and heard - said[0] <= _SEEN_WITHIN_TICKS:
                    seconds = (heard - said[0]) * TICK_S
                    velocity = (place[0] - said[1][0]) / seconds, (place[1] - said[1][1]) / seconds
                said = self._said[node] = heard, place, velocity
            if math.dist(at, place) <= within_m:
                near.append((node, place, said[2]))
        return near

    def feel(self, tick: int, at: Place, near: list[tuple[int, Place, Place]], own_map: OwnMap) -> None:
        """Note whether the last move was stopped; by none of those near and by no wall means by a silent body."""
        self._found.forget(tick)
        if self._commanded is None:
            self.held_ticks = 0
            return
        (x, y), (vx, vy) = self._commanded
        step_m = math.hypot(vx, vy) * TICK_S
        if math.dist(at, (x, y)) > _HELD_SHARE * step_m:
            self.held_ticks = 0
            return
        self.held_ticks += 1
        ux, uy = vx * TICK_S / step_m, vy * TICK_S / step_m
        far = (at[0] + self._apart_m * ux, at[1] + self._apart_m * uy)
        if not self._rules.go_round or self.held_ticks % self._rules.bump_ticks or not own_map.clear_line(*at, *far):
            return
        for _, place, _ in near:
            ahead = (place[0] - at[0]) * ux + (place[1] - at[1]) * uy > 0.0
            if ahead and math.dist(at, place) <= self._apart_m + 2.0 * _TOUCH_M:
                return
        self._found.add(self._last_said(tick, at, (ux, uy)) or far, tick + tick_of(self._rules.remember_s))

    def _last_said(self, tick: int, at: Place, ahead: Place) -> Place | None:
        """The place ahead that a robot, silent now, said last; it must be one that this robot can touch."""
        table, neighbors = self._router.table, self._router.neighbors
        for node in sorted(table.known):
            if node in (STATION, self._router.node) or not neighbors.silent(node, tick):
                continue
            x, y = table.location_m(node)
            touches = abs(math.dist(at, (x, y)) - self._apart_m) <= _TOUCH_M
            if touches and (x - at[0]) * ahead[0] + (y - at[1]) * ahead[1] > 0.0:
                return x, y
        return None

    def command(self, at: Place, velocity_m_s: Place) -> None:
        """Note what the robot does in this tick."""
        self._commanded = (at, velocity_m_s) if math.hypot(*velocity_m_s) > 0.01 else None
