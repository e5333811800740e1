"""Giving way: what becomes of the velocity that a policy wants where other robots stand or walk (docs/bodies.md).

Avoid     reciprocal velocity obstacles (van den Berg, Lin & Manocha 2008): of the wanted velocity, others in 16
          directions at full and half speed, and standing, take the one with the least |v - wanted| + w / (time to
          contact), of equal ones that to the right. Who is fewer hops from the MS, of equal ones the lower id, has
          right of way: it leaves half of the avoiding to the other one, who does all of it.
Make room who wants to stand steps back from whoever comes near.
Back off  who is held up by a robot with right of way walks back for a moment.
Doors     a relay that waits in a narrow place steps on (doorways.py).
Round     bodies that say nothing are walked around (bodies_near.py, found_bodies.py).

A robot knows of others only what their frames say.
"""

from __future__ import annotations

import math
from typing import Final

from agents.bodies_near import Near
from agents.body import Action, Body
from agents.doorways import Doorways
from world.terms import NOBODY, TICK_S, UNREACHABLE, Place, tick_of

STILL: Final = (0.0, 0.0)
_DIRECTIONS: Final = 16
_TURNS: Final = tuple(
    math.radians(360.0 / _DIRECTIONS * turn) for k in range(1, _DIRECTIONS // 2 + 1) for turn in (-k, k)
)[: _DIRECTIONS - 1]
"""Right before left, small before large."""
_STANDING_COSTS: Final = 0.5
"""Standing costs this share of the wanted speed more than it differs from it: who walks goes round rather than wait."""
_STANDS_M_S: Final = 0.05
"""Who is slower stands, and does not avoid."""
_SOON_S: Final = 0.05
"""Shortest time to contact that counts."""
_AHEAD_S: Final = 0.5
"""So far ahead a velocity must lead over known free cells, and so far ahead who makes room looks."""

Neighbor = tuple[int, Place, Place]


class GivingWay:
    """Between the policy of one robot and its motion."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self._rules = body.config.rules.giving_way
        self._apart_m = 2.0 * body.config.body_radius_m
        self._near = Near(body.router, body.found, self._rules, self._apart_m)
        self._doorways = Doorways(body, self._rules, self._apart_m)
        self._back_until = -1
        self._room_until = -1
        self._held_ticks = 0
        self._was_at = body.at
        self._speed_m_s = body.config.rules.moving.speed_m_s

    def velocity(self, action: Action) -> Place:
        """The velocity that the robot takes, in m/s."""
        body, rules = self._body, self._rules
        if self._apart_m == 0.0:
            return action.velocity_m_s
        wanted = action.velocity_m_s
        if rules.clear_doors:
            wanted = self._doorways.velocity(action)
        reach_m = self._apart_m + rules.margin_m + 2.0 * rules.horizon_s * body.config.rules.moving.trace_speed_m_s
        near = self._near.look(body.tick, body.at, reach_m)
        self._near.feel(body.tick, body.at, near, body.map)
        if rules.avoid:
            wanted = self._avoid(wanted, near)
        self._near.command(body.at, wanted)
        self._was_at = body.at
        body.planner.led_aside = wanted != action.velocity_m_s or self._near.held_ticks > 0
        return wanted

    def _avoid(self, wanted: Place, near: list[Neighbor]) -> Place:
        tick, stands = self._body.tick, math.hypot(*wanted) < 0.01
        if stands or tick < self._room_until:
            room = self._make_room(near)
            if room is not None:
                # Who wants to stand at one place, and was pushed from it, does not press back at once.
                self._room_until = tick + tick_of(self._rules.back_s) if stands else self._room_until
                return room
        if stands:
            return STILL
        self._count_held(wanted)
        if self._backs_off(near):
            wanted = -wanted[0], -wanted[1]
        near = [*near, *((NOBODY, place, STILL) for place in self._body.found.places())]
        speed = math.hypot(*wanted)
        best, least = wanted, self._cost(wanted, wanted, speed, near)
        if least == 0.0:
            return wanted
        for velocity in _choices(wanted):
            if velocity == STILL or self._leads_over_floor(velocity):
                cost = self._cost(velocity, wanted, speed, near)
                if cost < least:
                    best, least = velocity, cost
        return best

    def _cost(self, velocity: Place, wanted: Place, speed: float, near: list[Neighbor]) -> float:
        """What is lost by a velocity: its difference from the wanted one, and the most urgent contact."""
        cost = math.dist(velocity, wanted)
        if velocity == STILL:
            cost += _STANDING_COSTS * speed
        urgent = 0.0
        for node, place, theirs in near:
            first = math.hypot(*theirs) > _STANDS_M_S and self._goes_first(node)
            # The other one is taken to add as much as this one to the change of their relative velocity.
            x, y = (2.0 * velocity[0] - wanted[0], 2.0 * velocity[1] - wanted[1]) if first else velocity
            soon = self._time_to_contact(place, (x - theirs[0], y - theirs[1]))
            if soon < self._rules.horizon_s:
                urgent = max(urgent, (0.5 if first else 1.0) * self._rules.weight_m / max(soon, _SOON_S))
        return cost + urgent

    def _time_to_contact(self, place: Place, closing: Place) -> float:
        """When a body comes as near as the margin allows if the robot moves so, relative to it; inf for never."""
        px, py = place[0] - self._body.at[0], place[1] - self._body.at[1]
        a, b = closing[0] ** 2 + closing[1] ** 2, px * closing[0] + py * closing[1]
        c = px * px + py * py - (self._apart_m + self._rules.margin_m) ** 2
        if b <= 0.0 or a == 0.0:
            return math.inf
        if c <= 0.0:
            # Within the margin: only who really comes nearer, not who goes along the edge.
            return 0.0 if b > 0.2 * math.sqrt(a * (px * px + py * py)) else math.inf
        square = b * b - a * c
        return c / (b + math.sqrt(square)) if square > 0.0 else math.inf

    def _goes_first(self, node: int) -> bool:
        """Whether this robot has right of way before a neighbor."""
        router = self._body.router
        neighbor = router.neighbors.by_id.get(node)
        if neighbor is None:
            return False
        hops = router.ms.hops if router.ms.nms != NOBODY else UNREACHABLE
        return (hops, router.node) < (neighbor.ms_hop, node)

    def _count_held(self, wanted: Place) -> None:
        """Count the ticks in which the robot came forward no faster than a third of what its policy wants."""
        (x, y), at = self._was_at, self._body.at
        forward = ((at[0] - x) * wanted[0] + (at[1] - y) * wanted[1]) / math.hypot(*wanted)
        slow = forward < math.hypot(*wanted) * TICK_S / 3.0
        self._held_ticks = self._held_ticks + 1 if slow else 0

    def _backs_off(self, near: list[Neighbor]) -> bool:
        """Whether the robot walks back now: somebody who goes first has held it up for long enough."""
        tick, rules = self._body.tick, self._rules
        if self._held_ticks >= rules.held_ticks:
            self._held_ticks = 0
            touch_m = self._apart_m + rules.margin_m
            beside = [node for node, place, _ in near if math.dist(place, self._body.at) <= touch_m]
            if beside and not all(self._goes_first(node) for node in beside):
                self._back_until = tick + tick_of(rules.back_s)
        return tick < self._back_until

    def _make_room(self, near: list[Neighbor]) -> Place | None:
        """The step, or standing, after which those near crowd the robot least; None if nobody does."""
        room_m = self._apart_m + self._rules.room_m
        at = self._body.at

        def crowd(velocity: Place) -> float:
            x, y = at[0] + _AHEAD_S * velocity[0], at[1] + _AHEAD_S * velocity[1]
            gaps = [max(0.0, room_m - math.dist((x, y), place)) for _, place, _ in near]
            return sum(gap * gap for gap in gaps)

        best, least = STILL, crowd(STILL)
        if least == 0.0:
            return None
        least *= 0.9  # a step must be worth it
        for velocity in _choices((self._speed_m_s, 0.0)):
            if self._leads_over_floor(velocity) and crowd(velocity) < least:
                best, least = velocity, crowd(velocity)
        return best

    def _leads_over_floor(self, velocity: Place) -> bool:
        x, y = self._body.at
        to = x + _AHEAD_S * velocity[0], y + _AHEAD_S * velocity[1]
        return self._body.map.clear_line(x, y, *to)


def _choices(wanted: Place) -> list[Place]:
    """Velocities beside the wanted one: in other directions and slower; the last of them is standing."""
    vx, vy = wanted
    out = [(0.5 * vx, 0.5 * vy)]
    for turn in _TURNS:
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = cos * vx - sin * vy, sin * vx + cos * vy
        out += [(x, y), (0.5 * x, 0.5 * y)]
    return [*out, STILL]
