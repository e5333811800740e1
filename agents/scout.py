"""Policy scout: our own rules on top of the paper's, for radios that walls stop (docs/scout.md). First that applies:

1. No route                                    APR, as in `vds`.
2. NMS silent, d_in or p(me, NMS) > r_in'      trace the NMS, look for a potential NMS.
3. The NMS holds me                            trace the NMS: yield.
4. RR, NMSR silent or d_out > r_out            trace the NMSR. (B, C)
5. otherwise                                   walk to the target. (B, C, D)

p(x, y) is the distance at which y will seem to be when heard from x, with the walls in between (predicted_links.py).
q is the next position:

B        p(q, NMS) > r_in' and not shrinking: stand; meanwhile adopt a potential NMS that is near at q.
C        in 2 to 5, a wall comes between q and a child: stand; unless B stops me, ask the child to yield (hold).
D        walk at 2 km/h, an SR only while more than 10 m remain ([paper 5.9] keeps 2 km/h for tracing).
need     an SR that B stopped for long enough is in need, and says so to all.
recruit  an SR in need takes over the target of a deeper SR in need.
wait     an SR in need has longer stall limits while others may come to help.
stretch  r_in' = 0.95 r_t for an SR in need, and for the relays behind it.

A robot uses only its own map, its senses and its neighbors' updates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from mypy_extensions import mypyc_attr

from agents.body import Body
from agents.predicted_links import PredictedLinks
from agents.vds import STILL, Vds, Velocity
from world.terms import NOBODY, TICK_S, Cls, Mode, Place, tick_of


@mypyc_attr(allow_interpreted_subclasses=True)
class Scout(Vds):
    """Decides for one robot."""

    DEFAULTS: ClassVar[Mapping[str, Any]] = {"rules.routing.r_in_share": 0.9, "rules.routing.r_out_share": 0.95}

    def __init__(self, body: Body) -> None:
        super().__init__(body)
        self._scouting = body.config.rules.scouting
        self._stretched_m = self._scouting.stretch_share * body.config.radius_m
        self._stopped_ticks = 0
        self._needed_tick = -(10**9)
        self._stretched_to = NOBODY
        self._leader = NOBODY
        """The deeper SR whose target this robot has taken over."""
        self._next: Place = body.at
        self.links = PredictedLinks(body, predict=self._scouting.predict)
        body.router.ms.links = self.links

    def behave(self, cls: Cls) -> tuple[Velocity, Mode]:
        """Rules 1 to 5."""
        ms = self.body.router.ms
        self.hold, self.links.held_from = NOBODY, None
        if self.body.tick < self.body.router.quiet_until or ms.nms == NOBODY:
            self._count(stopped=False)
            return super().behave(cls)
        self._lost_nms_m = self.body.router.table.location_m(ms.nms)
        self._stretch(cls)
        if cls is Cls.SR:
            self._recruit()
            self.search()
        else:
            self._leader = NOBODY
        velocity, mode, bound = self._move(cls)
        self._next = self.body.at[0] + TICK_S * velocity[0], self.body.at[1] + TICK_S * velocity[1]
        stopped = bound and self._scouting.predict and self._leaves_nms()
        self._count(stopped=stopped and cls is Cls.SR)
        if stopped:
            self.links.held_from = self._next
        child = self._loses_child() if self._scouting.shield else NOBODY
        if child != NOBODY and not stopped:
            self.hold = child
        return (STILL, Mode.WAIT) if stopped or child != NOBODY else (velocity, mode)

    def _move(self, cls: Cls) -> tuple[Velocity, Mode, bool]:
        """Rules 2 to 5; the last value tells whether B may stop the robot."""
        tick, router = self.body.tick, self.body.router
        nms = router.ms.nms
        if router.ms.weak(tick) or (self._scouting.shield and router.neighbors.by_id[nms].hold == router.node):
            return self.trace(nms), Mode.INNER, False
        if cls is Cls.RR and self.nmsr != NOBODY and router.neighbors.distance_m(self.nmsr, tick) > self.r_out_m:
            return self.trace(self.nmsr), Mode.OUTER, True
        return *self.walk(self._speed_m_s(cls)), True

    def _speed_m_s(self, cls: Cls) -> float:
        """D: the walking speed."""
        moving, scouting = self.rules.moving, self._scouting
        near = cls is Cls.SR and self.to_target.remaining_m(self.body.at) <= scouting.hurry_beyond_m
        return moving.trace_speed_m_s if scouting.hurry and not near else moving.speed_m_s

    def _leaves_nms(self) -> bool:
        """B: whether the next step leads out of the reach of the NMS."""
        nms = self.body.router.ms.nms
        then = self.links.predicted_m(self._next, nms)
        return then > self.links.reach_m and then >= self.links.predicted_m(self.body.at, nms)

    def _loses_child(self) -> int:
        """C: the first child that a wall would hide, or NOBODY."""
        factor = self.body.config.wall_factor
        if factor == 1.0:
            return NOBODY
        router = self.body.router
        for child in router.inv:
            if math.dist(self._next, router.table.location_m(child)) > self.r_out_m:
                continue
            then = self.links.predicted_m(self._next, child)
            if then <= self.r_out_m:
                continue
            now = self.links.predicted_m(self.body.at, child)
            if now <= self.r_out_m or (factor < math.inf and then > now):
                return child
        return NOBODY

    def _count(self, *, stopped: bool) -> None:
        """Need: count the ticks in which B stopped the robot."""
        scouting = self._scouting
        change = 1 if stopped else -scouting.need_decay_ticks
        self._stopped_ticks = min(max(self._stopped_ticks + change, 0), scouting.need_max_ticks)
        self.need = self._stopped_ticks >= scouting.need_ticks
        if self.need:
            self._needed_tick = self.body.tick

    @property
    def _needed_lately(self) -> bool:
        return self.body.tick - self._needed_tick <= tick_of(self._scouting.recall_s)

    def _stretch(self, cls: Cls) -> None:
        """Stretch: make r_in' longer for a chain in need."""
        router = self.body.router
        ms = router.ms
        if self._scouting.stretch:
            wanted = self.need if cls is Cls.SR else self.msr != NOBODY and router.table.needs(self.msr)
            close = router.neighbors.distance_m(ms.nms, self.body.tick) < self._scouting.relax_share * ms.r_in_m
            if ms.nms != self._stretched_to or close:
                self._stretched_to = NOBODY
            if wanted and not close:
                self._stretched_to = ms.nms
        self.links.reach_m = self._stretched_m if self._stretched_to != NOBODY else ms.r_in_m

    def _recruit(self) -> None:
        """Recruit and wait: follow a deeper SR in need while the own chain is too short, with longer stall limits."""
        table, tick = self.body.router.table, self.body.tick
        others = table.search_robots()
        rules = self.rules.exploring
        self.explorer.patience_s = rules.stall_move_s, rules.stall_path_s
        if self._leader not in others:
            self._leader = NOBODY
        if self._needed_lately:
            if self._scouting.recruit:
                self._leader = self._deepest([n for n in others if table.needs(n)]) or self._leader
            helped = any(not table.needs(n) or table.target_m(n) == self.target for n in others)
            if self._scouting.wait and helped:
                self.explorer.patience_s = self._scouting.wait_move_s, self._scouting.wait_path_s
        if self._leader != NOBODY and not self.explorer.is_taboo(tick, table.target_m(self._leader)):
            self.target = table.target_m(self._leader)
        else:
            self._leader = NOBODY

    def _deepest(self, needy: list[int]) -> int:
        """The deepest of some SRs that have another target, not taboo, if it is deeper than this robot; else 0."""
        body, table, margin = self.body, self.body.router.table, self._scouting.deeper_m
        helpful = []
        for node in needy:
            target = table.target_m(node)
            if target != self.target and not self.explorer.is_taboo(body.tick, target):
                helpful.append(node)
        if not helpful:
            return 0
        mine, *depths = body.ms_distance([body.at, *(table.location_m(node) for node in helpful)])
        deeper = []
        for node, depth_m in zip(helpful, depths, strict=True):
            ahead = depth_m - mine
            if ahead > margin or (abs(ahead) <= margin and node < body.config.node):
                deeper.append((ahead, -node))
        return -max(deeper)[1] if deeper else 0

    def search(self) -> None:
        """As in `vds`, but a follower keeps its leader's target until it stalls."""
        if self._leader == NOBODY:
            super().search()
            return
        body = self.body
        assert self.target is not None
        if self.explorer.stalled(body.tick, body.at, self.target, self.to_target.remaining_m(body.at)):
            self._leader = NOBODY
            self.target = self.choose_target()
