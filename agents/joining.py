"""Where in the tree a search robot should hang for its target (docs/sortie.md): join and back.

join  A robot in need walks to a neighbor that is nearer to its target on foot, along a path on which it stays within
      reach of its NMS until the neighbor will do as NMS. If no neighbor can be reached so, but some other robot of the
      network is nearer to the target, it walks to its NMS first.
back  A robot whose way to its target is the long one round a loop goes up its chain.
"""

from __future__ import annotations

import math
from typing import Final

from agents.body import Body
from agents.config import Sorties
from agents.planner import Reach
from agents.predicted_links import PredictedLinks
from world.terms import NOBODY, Place, tick_of

_LOOK_TICKS: Final = 10
"""Time between two choices of a neighbor."""
_RENEW_TICKS: Final = 50
"""Time for which path lengths from the target are good enough."""
_AT_NMS_M: Final = 2.0
_SURE_SHARE: Final = 0.95
"""Of the distance at which a potential NMS may be adopted: the robot comes a little nearer than it must."""
_SAMPLE_M: Final = 1.0
"""Distance between the places of a path at which its links are predicted."""


class JoinLinks(PredictedLinks):
    """The links of a robot that wants one certain neighbor as its NMS, or none."""

    def __init__(self, body: Body, *, predict: bool, adopt_m: float) -> None:
        """`adopt_m`: a potential NMS is nearer than this (rule b [paper 3.4])."""
        super().__init__(body, predict=predict)
        self.adopt_m = adopt_m
        self.wanted = NOBODY

    def leaving(self) -> bool:
        """Whether the NMS is to be changed: B stops the robot, or the neighbor that it joins is near."""
        return super().leaving() or self._near()

    def lasting(self, node: int) -> bool:
        """While the robot joins a neighbor that is near, no other one will do."""
        return node == self.wanted if self._near() else super().lasting(node)

    def _near(self) -> bool:
        if self.wanted == NOBODY:
            return False
        return self.neighbors.distance_m(self.wanted, self._body.tick) <= self.adopt_m


class Joining:
    """Whom one robot joins."""

    def __init__(self, body: Body, rules: Sorties, links: JoinLinks) -> None:
        self._body = body
        self._rules = rules
        self._links = links
        self.active = False
        self._began_tick = 0
        self._look_tick = 0
        self._not_before = 0
        self._back_tick = 0
        self._goes_back = False
        self._reach: Reach | None = None
        """Path lengths from the target."""
        self._reach_of: tuple[Place, int] | None = None

    def node(self, target: Place, *, need: bool) -> int:
        """Whom to walk to now: the neighbor that the robot joins, or its NMS; NOBODY if it does not join."""
        tick, ms = self._body.tick, self._body.router.ms
        if not self.active:
            if not need or tick < self._not_before:
                return NOBODY
            self.active, self._began_tick, self._look_tick, self._links.wanted = True, tick, tick, NOBODY
        wanted = self._links.wanted
        if wanted != NOBODY and (wanted == ms.nms or self._body.router.neighbors.silent(wanted, tick)):
            self._links.wanted, self._look_tick = NOBODY, tick
        if tick >= self._look_tick:
            self._links.wanted = self._nearer_neighbor(target)
            self._look_tick = tick + _LOOK_TICKS
        if tick - self._began_tick > tick_of(self._rules.join_most_s):
            return self._pause()
        if self._links.wanted != NOBODY:
            return self._links.wanted
        away = math.dist(self._body.at, self._body.router.table.location_m(ms.nms)) > _AT_NMS_M
        return ms.nms if away and self._anybody_nearer(target) else self._pause()

    def back(self, target: Place) -> int:
        """Back: the NMS of its NMS if the way to the target leads through deeper places than both its ends, or NOBODY.

        The chain would have to follow that way, the long one round a loop. From higher up the short one is nearer.
        """
        tick, router = self._body.tick, self._body.router
        if tick >= self._back_tick:
            self._back_tick = tick + _LOOK_TICKS
            self._goes_back = self._over_deeper_places(target)
        neighbor = router.neighbors.by_id.get(router.ms.nms)
        return neighbor.nms if self._goes_back and neighbor is not None else NOBODY

    def _over_deeper_places(self, target: Place) -> bool:
        body = self._body
        planner, g = body.planner, body.map.geometry
        path = planner.path(planner.nearest_free(g.index(*body.at)), planner.nearest_free(g.index(*target)))
        way = path[:: max(1, round(_SAMPLE_M / g.resolution_m))]
        if len(way) * _SAMPLE_M <= 2.0 * self._rules.back_m:
            return False
        here_m, there_m, *between_m = body.ms_distance([body.at, target, *(g.center(cell) for cell in way)])
        return max(between_m) > max(here_m, there_m) + self._rules.back_m

    def stop(self) -> None:
        """Join nobody."""
        self.active, self._links.wanted = False, NOBODY

    def _pause(self) -> int:
        self.stop()
        self._not_before = self._body.tick + tick_of(self._rules.join_pause_s)
        return NOBODY

    def _nearer_neighbor(self, target: Place) -> int:
        """The neighbor nearest to the target that can be joined on the way; NOBODY if none is nearer than the NMS."""
        router, tick = self._body.router, self._body.tick
        ms = router.ms
        offers = []
        for node, neighbor in sorted(router.neighbors.by_id.items()):
            below = neighbor.nms == router.node or neighbor.ms_hop > ms.hops + 1
            if node != ms.nms and not below and not router.neighbors.silent(node, tick):
                offers.append((self._to_target_m(target, node), node))
        enough_m = self._to_target_m(target, ms.nms) - self._rules.join_better_m
        for length_m, node in sorted(offers):
            if length_m >= enough_m:
                break
            if self._joinable(node):
                return node
        return NOBODY

    def _anybody_nearer(self, target: Place) -> bool:
        """Whether some node of the network is nearer to the target than the NMS."""
        table, ms = self._body.router.table, self._body.router.ms
        enough_m = self._to_target_m(target, ms.nms) - self._rules.join_better_m
        for node in sorted(table.known):
            routed = node not in (table.node, ms.nms) and table.next_hop_to(node) != NOBODY
            if routed and self._to_target_m(target, node) < enough_m:
                return True
        return False

    def _to_target_m(self, target: Place, node: int) -> float:
        planner, g, now = self._body.planner, self._body.map.geometry, self._body.tick // _RENEW_TICKS
        if self._reach is None or self._reach_of != (target, now):
            self._reach_of = target, now
            self._reach = planner.reach(planner.nearest_free(g.index(*target)))
        return self._reach.length_m(planner.nearest_free(g.index(*self._body.router.table.location_m(node))))

    def _joinable(self, node: int) -> bool:
        """Whether, on the way to a neighbor, the NMS stays within reach until the neighbor can be adopted."""
        body, links, nms = self._body, self._links, self._body.router.ms.nms
        adopt_m = _SURE_SHARE * links.adopt_m
        if links.predicted_m(body.at, node) <= adopt_m:
            return True
        planner, g = body.planner, body.map.geometry
        there_m = body.router.table.location_m(node)
        at, there = planner.nearest_free(g.index(*body.at)), planner.nearest_free(g.index(*there_m))
        now_m = links.predicted_m(body.at, nms)
        for cell in planner.path(at, there)[:: max(1, round(_SAMPLE_M / g.resolution_m))]:
            place = g.center(cell)
            if links.predicted_m(place, nms) > max(links.r_in_m, now_m):
                return False
            if links.predicted_m(place, node) <= adopt_m:
                return True
        return False
