"""The paper's policy: SRRC and the behavior algorithm, in our reading [paper 5.7]. First that applies:

1. No route to the MS       APR: go to where the NMS was, then over the known map towards the MS, at 2 km/h.
2. d_in > r_in              inner link recovery: trace the NMS at 2 km/h, and look for a potential NMS (nms.py).
3. RR and d_out > r_out     outer link recovery: trace the NMSR at 2 km/h.
4. otherwise                walk to the target at 1 km/h. An SR chooses its target; an RR has its MSR's.

A neighbor that is silent is beyond r_in and r_out (rule A [paper 3.7]).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from mypy_extensions import mypyc_attr

from agents.body import Action, Body
from agents.explorer import Explorer
from agents.srrc import Classifier, eligible_msrs, farthest_msr
from agents.walker import Walker
from world.terms import NOBODY, Cls, Mode, Place

Velocity = tuple[float, float]

STILL: Velocity = (0.0, 0.0)


@mypyc_attr(allow_interpreted_subclasses=True)
class Vds:
    """Decides for one robot. Subclass it to replace `choose_msr` or `choose_target` (docs/writing-a-policy.md)."""

    DEFAULTS: ClassVar[Mapping[str, Any]] = {}
    """Values that this policy wants for keys that a scenario leaves out."""

    def __init__(self, body: Body) -> None:
        self.body = body
        rules = body.config.rules
        self.rules = rules
        self.classifier = Classifier(rules.classing)
        self.explorer = Explorer(rules.exploring, body.map, body.planner, body.rng)
        self.r_in_m = body.router.ms.r_in_m
        self.r_out_m = rules.routing.r_out_share * body.config.radius_m
        self.to_target = Walker(body.map, body.planner, same_goal_m=0.05)
        self._tracing = Walker(body.map, body.planner, same_goal_m=0.5)
        self._there_m = 2.0 * body.map.geometry.resolution_m
        self._lost_nms_m: Place | None = None
        """Where the NMS was when there last was a route; None when the robot has been there since."""
        self.target: Place | None = None
        self.msr = NOBODY
        self.hold = NOBODY
        """Announced to neighbors; a policy may set it, as scout does."""
        self.need = False
        """Announced to all; a policy may set it, as scout does."""

    @property
    def nmsr(self) -> int:
        """Next hop to the MSR [paper 5.1]."""
        return self.body.router.table.next_hop_to(self.msr)

    def step(self) -> Action:
        """The decision of this tick: class, MSR, target and movement."""
        router = self.body.router
        before = self.classifier.cls
        cls = self.classifier.step(self.body.tick, router.inv)
        if cls is Cls.RR:
            self._follow_msr()
            self.explorer.rest()
        elif before is Cls.RR:
            self.msr = NOBODY
        velocity, mode = self.behave(cls)
        return Action(velocity, mode, cls, self.target or self.body.at, self.msr, self.hold, self.need)

    def behave(self, cls: Cls) -> tuple[Velocity, Mode]:
        """Velocity and mode: the order of rules in [paper 5.7]."""
        tick, router = self.body.tick, self.body.router
        if tick < router.quiet_until:
            return STILL, Mode.LOST
        nms = router.ms.nms
        if nms == NOBODY:
            return self.recover_path(), Mode.LOST
        self._lost_nms_m = router.table.location_m(nms)
        if cls is Cls.SR:
            self.search()
        if router.ms.weak(tick):
            return self.trace(nms), Mode.INNER
        if cls is Cls.RR:
            nmsr = self.nmsr
            if nmsr != NOBODY and router.neighbors.distance_m(nmsr, tick) > self.r_out_m:
                return self.trace(nmsr), Mode.OUTER
            if not self.rules.moving.relay_walks:
                return STILL, Mode.WAIT
        return self.walk(self.rules.moving.speed_m_s)

    # -- relay ---------------------------------------------------------------------------------------------------------

    def choose_msr(self) -> int:
        """MSR selection rule [paper 4.4, 4.5, 4.6]."""
        body, rules = self.body, self.rules.classing
        table = body.router.table
        candidates = eligible_msrs(table, body.router.ms.nms)
        if self.msr in candidates and (body.tick + body.config.node) % rules.msr_compare_ticks:
            return self.msr
        return farthest_msr(candidates, table, body.ms_distance, self.msr, rules.msr_margin_m)

    def _follow_msr(self) -> None:
        """Choose the MSR of a relay and take its target; without an MSR keep the last target [paper 4.7, 4.8]."""
        self.msr = self.choose_msr()
        if self.msr != NOBODY and self.rules.classing.copy_target:
            self.target = self.body.router.table.target_m(self.msr)

    # -- search --------------------------------------------------------------------------------------------------------

    def choose_target(self) -> Place | None:
        """Decision-theoretic choice [paper 6.1, 6.2]; None if there is no frontier."""
        body = self.body
        table = body.router.table
        others = [table.target_m(node) for node in table.search_robots()]
        chosen = self.explorer.select(body.tick, body.at, np.array(others).reshape(-1, 2))
        if chosen is None:
            return None
        target, reach = chosen
        self.to_target.take(body.tick, body.at, target, reach)
        return target

    def search(self) -> None:
        """Choose a new target when one is due, or when the robot has stalled on its way to the present one."""
        tick, at = self.body.tick, self.body.at
        due = self.explorer.done(at, self.target, self.rules.moving.arrive_m)
        if not due and self.target is not None:
            due = self.explorer.stalled(tick, at, self.target, self.to_target.remaining_m(at))
        if due:
            self.target = self.choose_target()

    # -- movement ------------------------------------------------------------------------------------------------------

    def trace(self, node: int) -> Velocity:
        """Velocity towards where a node was last heard to be, at the accelerated speed [paper 5.9]."""
        return self._run_to(self.body.router.table.location_m(node))

    def _run_to(self, place: Place) -> Velocity:
        return self._tracing.velocity(self.body.tick, self.body.at, place, self.rules.moving.trace_speed_m_s)

    def walk(self, speed_m_s: float) -> tuple[Velocity, Mode]:
        """Velocity towards the target, or back to the MS while a stalled SR retreats [paper 6.6]."""
        goal, tick = self.target, self.body.tick
        if self.classifier.cls is Cls.SR and tick < self.explorer.retreat_until:
            goal = self.body.config.station_m
        if goal is None:
            return STILL, Mode.WAIT
        return self.to_target.velocity(tick, self.body.at, goal, speed_m_s), Mode.WALK

    def recover_path(self) -> Velocity:
        """APR [paper 5.8]: first to where the NMS was when the route was lost, from there towards the MS.

        Not to where the lost NMS is now: it may be lost as well, and each robot would follow the other.
        """
        if self._lost_nms_m is not None and math.dist(self._lost_nms_m, self.body.at) < self._there_m:
            self._lost_nms_m = None
        return self._run_to(self._lost_nms_m or self.body.config.station_m)
