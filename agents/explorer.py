"""Where a search robot goes next: the decision-theoretic choice of a frontier, and the way out of a stall.

Choice [paper 6.2], after Burgard, Moors, Stachniss & Schneider 2005: the frontier cell of the own map with the highest
score = utility x max(0, 1 - sum over other SRs' targets within reach of (1 - d / reach)) - path length.

Stall [paper 6.5, 6.6]: a robot whose chain is taut cannot reach its frontier. After a while it declares the
surroundings of its target taboo, for longer each time in a row. In the end it walks back towards the MS for a while.
"""

from __future__ import annotations

import math
import random
from typing import Final

import numpy as np
from mypy_extensions import mypyc_attr
from numpy.typing import NDArray

from agents.config import Exploring
from agents.own_map import OwnMap
from agents.planner import Planner, Reach
from world.terms import Place, tick_of

_LIMITS_M: Final = 3.0, 12.0, 48.0, math.inf
"""`select` searches only so far at first: no frontier beyond a limit can beat one that scores utility - limit."""


def score(
    frontiers_m: NDArray[np.float64], lengths_m: NDArray[np.float64], targets_m: NDArray[np.float64], rules: Exploring
) -> NDArray[np.float64]:
    """Score of each frontier, shape (n,), in metres: its discounted utility minus the length of the path [paper 6.2].

    Args:
        frontiers_m: (n, 2) places.
        lengths_m: (n,) path lengths.
        targets_m: (t, 2) targets that other SRs announced.
        rules: utility of a frontier, and how far a target discounts others.
    """
    gaps = np.hypot(frontiers_m[:, None, 0] - targets_m[None, :, 0], frontiers_m[:, None, 1] - targets_m[None, :, 1])
    taken = np.maximum(0.0, 1.0 - gaps / rules.discount_m).sum(axis=1)
    worth: NDArray[np.float64] = rules.utility_m * np.maximum(0.0, 1.0 - taken) - lengths_m
    return worth


@mypyc_attr(allow_interpreted_subclasses=True)
class Explorer:
    """Target of one search robot, and its memory of stalls."""

    def __init__(self, rules: Exploring, own_map: OwnMap, planner: Planner, rng: random.Random) -> None:
        self._rules = rules
        self._map = own_map
        self._planner = planner
        self._rng = rng
        self._taboo: list[tuple[float, float, int]] = []
        self.stalls = 0
        """Stalls in a row: since enough new cells were seen."""
        self._new_cells = 0
        self._moved_from: tuple[Place, int] | None = None
        self._shortened_from: tuple[Place, float, int] | None = None
        self.patience_s = rules.stall_move_s, rules.stall_path_s
        """Stall limits: seconds without a move, seconds without a shorter path."""
        self.retreat_until = -1
        """Until this tick the robot walks back towards the MS."""

    def discovered(self, cells: int) -> None:
        """Count new cells from the own lidar: enough of them end a row of stalls."""
        self._new_cells += cells
        if self._new_cells >= self._rules.progress_cells:
            self._new_cells = 0
            self.stalls = 0

    def rest(self) -> None:
        """Start both stall limits anew: something other than the search moved the robot."""
        self._moved_from = None
        self._shortened_from = None

    def done(self, at: Place, target: Place | None, arrive_m: float) -> bool:
        """Whether a new target is due: there is none, it is reached [paper 6.1], or it is no frontier [paper 6.3]."""
        if target is None or math.dist(at, target) <= arrive_m:
            return True
        return self._rules.reselect_when_seen and not self._map.is_frontier(self._map.geometry.index(*target))

    def select(self, tick: int, at: Place, others_m: NDArray[np.float64]) -> tuple[Place, Reach] | None:
        """The best frontier that is not taboo, else the best of all; None if no frontier can be reached."""
        cells = self._map.frontiers()
        if not cells.size:
            return None
        places = self._map.geometry.centers(cells)
        allowed = self.allowed(tick, places)
        source = self._planner.nearest_free(self._map.geometry.index(*at))
        for limit_m in _LIMITS_M:
            reach = self._planner.reach(source, limit_m)
            lengths = reach.lengths_m(cells)
            reached = np.flatnonzero(lengths < math.inf)
            open_ = reached[allowed[reached]]
            if open_.size:
                worth = score(places[open_], lengths[open_], others_m, self._rules)
                best = int(np.argmax(worth))
                # No frontier beyond the limit can score more than this.
                if worth[best] >= self._rules.utility_m - limit_m:
                    return self._place(places, open_[best]), reach
        if not reached.size:
            return None
        # Every frontier is taboo: take the best of all, and perhaps walk back first [paper 6.6].
        if self.stalls >= self._rules.retreat_after and self._rng.random() < self._rules.retreat_probability:
            seconds = self._rng.uniform(self._rules.retreat_min_s, self._rules.retreat_max_s)
            self.retreat_until = tick + tick_of(seconds)
        worth = score(places[reached], lengths[reached], others_m, self._rules)
        return self._place(places, reached[int(np.argmax(worth))]), reach

    @staticmethod
    def _place(places: NDArray[np.float64], row: np.int64) -> Place:
        x, y = places[row].tolist()
        return x, y

    def is_taboo(self, tick: int, place: Place) -> bool:
        """Whether a stall near this place is still remembered."""
        return not self.allowed(tick, np.array([place]))[0]

    def allowed(self, tick: int, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) whether no stall near a place is still remembered."""
        self._taboo = [t for t in self._taboo if t[2] > tick]
        allowed = np.ones(len(places), bool)
        for x, y, _ in self._taboo:
            allowed &= np.hypot(places[:, 0] - x, places[:, 1] - y) > self._rules.taboo_radius_m
        return allowed

    def stalled(self, tick: int, at: Place, target: Place, remaining_m: float) -> bool:
        """Whether the robot has long not moved, or not come nearer to its target; then the target becomes taboo."""
        rules = self._rules
        if not rules.stall:
            return False
        if self._moved_from is None or math.dist(at, self._moved_from[0]) >= rules.stall_move_m:
            self._moved_from = (at, tick)
        last = self._shortened_from
        if last is None or last[0] != target or remaining_m <= last[1] - rules.stall_path_m:
            last = self._shortened_from = (target, remaining_m, tick)
        move_s, path_s = self.patience_s
        stuck = tick - self._moved_from[1] >= tick_of(move_s) or tick - last[2] >= tick_of(path_s)
        if stuck:
            seconds = rules.taboo_s * self._rng.uniform(0.5, 1.5) * 2.0 ** min(self.stalls, 4)
            self._taboo.append((*target, tick + tick_of(seconds)))
            self.stalls += 1
            self.rest()
        return stuck
