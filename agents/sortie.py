"""Policy sortie: leave the network for seconds, on purpose, and carry home what was seen (docs/sortie.md).

Its rules stand on top of those of `scout`:

sortie  an SR that B has stopped for a while, and whose frontier is near, ignores B. It scans the nearest frontiers as
        long as the way out and home fits its budget, and comes back to where it left. Each stall in a row doubles the
        budget.
worth   a frontier is worth 6 m of path, not 20 m: a herd of robots does not swing between slivers far apart.
join    an SR in need goes over to a neighbor that is nearer to its target (joining.py).
back    an SR whose way to its target is the long one round a loop goes back up its chain.
depth   an SR that stalled in need, and can't leave, takes only frontiers less deep than it is for a while.

A robot on a sortie says so (Mode.AWAY), so its absence is planned: it is no lost path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from mypy_extensions import mypyc_attr

from agents.body import Body
from agents.explorer import score
from agents.joining import Joining, JoinLinks
from agents.outing import Outing
from agents.scout import Scout
from agents.vds import Velocity
from world.terms import NOBODY, Cls, Mode, Place, tick_of


@mypyc_attr(allow_interpreted_subclasses=True)
class Sortie(Scout):
    """Decides for one robot."""

    DEFAULTS: ClassVar[Mapping[str, Any]] = {**Scout.DEFAULTS, "rules.exploring.utility_m": 6.0}

    def __init__(self, body: Body) -> None:
        super().__init__(body)
        self._sorties = body.config.rules.sorties
        adopt_m = self.rules.routing.adopt_share * self.r_in_m
        self._join_links = JoinLinks(body, predict=self._scouting.predict, adopt_m=adopt_m)
        self.links = body.router.ms.links = self._join_links
        self._joining = Joining(body, self._sorties, self._join_links)
        self._outing: Outing | None = None
        self._not_before = 0
        """No sortie begins before this tick."""
        self._shallow_until = -1
        self._shallower_than_m = math.inf
        self._stalls = 0
        """Of the explorer, at the last choice of a target."""
        self._searched_in_need = False

    def behave(self, cls: Cls) -> tuple[Velocity, Mode]:
        """On a sortie its own rule, else those of `scout`; then perhaps the begin of a sortie."""
        if self._outing is not None:
            if self._goes_on(self._outing, cls):
                return self._go(self._outing, cls), Mode.AWAY
            self._end()
        decision = super().behave(cls)
        if self._sorties.leave and cls is Cls.SR and self._may_leave():
            self._outing = Outing(self.body, tick_of(self._budget_s), self._sorties.pace_m_s)
            self._joining.stop()
        return decision

    # -- sortie --------------------------------------------------------------------------------------------------------

    @property
    def _budget_s(self) -> float:
        return self._sorties.budget_s * 2.0 ** min(self.explorer.stalls, self._sorties.budget_doublings)

    def _may_leave(self) -> bool:
        """Whether B has stopped the robot for long enough, near enough to its target."""
        tick, sorties = self.body.tick, self._sorties
        bound = self.body.router.ms.nms == NOBODY or self.hold != NOBODY or self._joining.active
        waits = tick < max(self._not_before, self.explorer.retreat_until)
        if bound or waits or self.target is None or self._stopped_ticks < sorties.stopped_ticks:
            return False
        return self._is_near()

    def _is_near(self) -> bool:
        """Whether the way to the target takes no more of the budget than it may."""
        outward_m = self._sorties.outward_share * self._sorties.pace_m_s * self._budget_s
        return self.to_target.remaining_m(self.body.at) <= outward_m

    def _goes_on(self, outing: Outing, cls: Cls) -> bool:
        """Whether the sortie is not over: not at home, nor anywhere else in the network once its time has come."""
        tick, ms = self.body.tick, self.body.router.ms
        if cls is not Cls.SR or tick < self.body.router.quiet_until:
            return False
        if not outing.returning:
            self._advance(outing)
        if not outing.returning:
            return True
        at_home = math.dist(self.body.at, outing.home) < self._sorties.home_m
        overdue = tick - outing.until > tick_of(self._sorties.overdue_s)
        return not (at_home or overdue or (ms.nms != NOBODY and not ms.weak(tick)))

    def _advance(self, outing: Outing) -> None:
        """Take the next frontier when one is due; turn back when there is no time for any."""
        body = self.body
        if outing.late():
            outing.turn_back()
        elif self.explorer.done(body.at, self.target, self.rules.moving.arrive_m):
            found = outing.next_frontier()
            if found is None:
                outing.turn_back()
            else:
                self.target, reach = found
                self.to_target.take(body.tick, body.at, self.target, reach)

    def _go(self, outing: Outing, cls: Cls) -> Velocity:
        """Velocity to the next frontier, or home at the accelerated speed."""
        nms = self.body.router.ms.nms
        self.hold, self.links.held_from = NOBODY, None
        self._count(stopped=False)
        if nms != NOBODY:
            self._lost_nms_m = self.body.router.table.location_m(nms)
        if outing.returning or self.target is None:
            return self._run_to(outing.home)
        return self.to_target.velocity(self.body.tick, self.body.at, self.target, self._speed_m_s(cls))

    def _end(self) -> None:
        self._outing = None
        self._not_before = self.body.tick + tick_of(self._sorties.rest_s)
        self.explorer.rest()
        if self.classifier.cls is Cls.SR and self.body.router.ms.nms != NOBODY:
            self.target = self.choose_target()

    # -- join ----------------------------------------------------------------------------------------------------------

    def _move(self, cls: Cls) -> tuple[Velocity, Mode, bool]:
        """As `scout`, but an SR in need joins."""
        router, tick = self.body.router, self.body.tick
        nms = router.ms.nms
        if cls is not Cls.SR or self.target is None or tick < self.explorer.retreat_until:
            self._joining.stop()
            return super()._move(cls)
        node = self._joining.node(self.target, need=self.need) if self._sorties.join else NOBODY
        if node == NOBODY and self._sorties.back:
            node = self._joining.back(self.target)
        held = self._scouting.shield and router.neighbors.by_id[nms].hold == router.node
        if node == NOBODY or held or router.ms.weak(tick):
            return super()._move(cls)
        return self.trace(node), Mode.WALK, True

    # -- depth ---------------------------------------------------------------------------------------------------------

    def search(self) -> None:
        """As in `scout`."""
        self._searched_in_need = self.need and self._leader == NOBODY
        super().search()

    def choose_target(self) -> Place | None:
        """As in `scout`, but after a stall in need the same target, if it is near now, or a shallower one."""
        tick, stalled = self.body.tick, self._searched_in_need and self.explorer.stalls > self._stalls
        self._stalls, self._searched_in_need = self.explorer.stalls, False
        if self._sorties.leave and stalled and self.target is not None and self._is_near():
            return self.target
        if self._sorties.depth and stalled and tick >= self._shallow_until:
            self._shallow_until = tick + tick_of(self._sorties.depth_s)
            self._shallower_than_m = self.body.ms_distance([self.body.at])[0] - self._sorties.depth_m
        place = self._shallow_target() if tick < self._shallow_until else None
        return super().choose_target() if place is None else place

    def _shallow_target(self) -> Place | None:
        """The best of the frontiers that are no deeper than the limit and not taboo; None if there is none."""
        body, g = self.body, self.body.map.geometry
        cells = body.map.frontiers()
        if not cells.size:
            return None
        reach = body.planner.reach(body.planner.nearest_free(g.index(*body.at)))
        places, lengths_m = g.centers(cells), reach.lengths_m(cells)
        open_ = np.flatnonzero((lengths_m < math.inf) & self.explorer.allowed(body.tick, places))
        depths_m = np.array(body.ms_distance([(x, y) for x, y in places[open_].tolist()]))
        open_ = open_[depths_m <= self._shallower_than_m] if open_.size else open_
        if not open_.size:
            return None
        table = body.router.table
        others_m = np.array([table.target_m(node) for node in table.search_robots()]).reshape(-1, 2)
        best = open_[int(np.argmax(score(places[open_], lengths_m[open_], others_m, self.rules.exploring)))]
        target = g.center(int(cells[best]))
        self.to_target.take(body.tick, body.at, target, reach)
        return target
