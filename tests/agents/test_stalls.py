"""Stall and retreat, second by second, and the choice among frontiers [paper 6.1 to 6.6]."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from agents.config import Exploring, Rules
from agents.explorer import Explorer
from agents.own_map import OwnMap
from agents.planner import Planner
from tests.helpers.team import GEOMETRY, Team, config_of
from world.terms import Cls, Place

NOBODY_ELSE = np.zeros((0, 2))
AT: Place = (10.25, 3.25)
FAR: Place = (30.25, 3.25)


class Fixed(random.Random):
    """Gives the middle of every range, and the number that it was told to give."""

    def __init__(self, number: float = 0.0, share: float = 0.5) -> None:
        super().__init__(0)
        self.number, self.share = number, share

    def random(self) -> float:
        """The number."""
        return self.number

    def uniform(self, a: float, b: float) -> float:
        """A share of the range."""
        return a + self.share * (b - a)


def corridor(*dark_x: float, rng: random.Random | None = None, rules: Exploring | None = None) -> Explorer:
    """A corridor from x = 1 to 59, known but for a niche at each of these places."""
    own = OwnMap(config_of(1, (2.0, 3.0), Rules()))
    odds = np.full(GEOMETRY.size, 1, np.int8)
    odds[Team.inside((1.0, 2.0, 59.0, 4.0))] = -1
    for x in dark_x:
        odds[Team.inside((x, 3.0, x + 1.0, 4.0))] = 0
    cells = np.flatnonzero(odds)
    own.apply(cells.astype(np.uint32), odds[cells])
    return Explorer(rules or Exploring(), own, Planner(own), rng or Fixed())


def choice(explorer: Explorer, tick: int, at: Place = AT, others: np.ndarray = NOBODY_ELSE) -> Place:
    """The target that it selects."""
    chosen = explorer.select(tick, at, others)
    assert chosen is not None
    return chosen[0]


def stall(explorer: Explorer, start: int, target: Place, at: Place = AT) -> int:
    """Stand until that counts as a stall; returns the tick."""
    tick = start
    while not explorer.stalled(tick, at, target, 20.0):
        tick += 1
        assert tick < start + 1000
    return tick


# -- choice ------------------------------------------------------------------------------------------------------------


def test_the_nearest_frontier_on_foot_is_the_best_if_nobody_else_is_there() -> None:
    assert choice(corridor(5.0, 20.0), 0)[0] == pytest.approx(6.25, abs=0.01)
    assert choice(corridor(1.0, 14.0), 0)[0] == pytest.approx(13.75, abs=0.01)


def test_what_another_search_robot_has_announced_is_worth_less_the_nearer_it_is() -> None:
    """At 3.5 m on foot and 5 m away from the target of another one it scores 20 x 5/8 - 3.5 m; a free one 20 - 7 m."""
    for gap_m, first in ((1.0, False), (5.0, False), (7.0, True)):
        explorer = corridor(14.0, 2.0)
        near = (13.75, 3.25)
        others = np.array([(near[0] + gap_m, 3.25)])
        assert (choice(explorer, 0, others=others)[0] > AT[0]) == first


@pytest.mark.parametrize("far_m", [11.0, 13.0, 30.0, 47.0, 49.0])
def test_a_frontier_is_found_however_far_it_is(far_m: float) -> None:
    explorer = corridor(8.0 + far_m)
    assert choice(explorer, 0, (8.25, 3.25))[0] == pytest.approx(7.75 + far_m, abs=0.6)


@pytest.mark.parametrize("taken", [False, True])
def test_a_free_frontier_beyond_the_first_search_beats_a_taken_one_within_it(taken: bool) -> None:
    """The free one is 12.3 m away in the west, the other 7 m in the east; the first search ends at 12 m."""
    others = np.array([(21.25, 3.25)]) if taken else NOBODY_ELSE
    assert (choice(corridor(1.0, 21.5), 0, (14.25, 3.25), others)[0] < 5.0) == taken


def test_without_a_frontier_there_is_no_target() -> None:
    assert corridor().select(0, AT, NOBODY_ELSE) is None


# -- stall -------------------------------------------------------------------------------------------------------------


def test_who_did_not_move_a_metre_in_twenty_seconds_has_stalled() -> None:
    explorer = corridor(30.0)
    assert stall(explorer, 7, FAR) == 207
    explorer = corridor(30.0)
    explorer.stalled(0, AT, FAR, 20.0)
    explorer.stalled(150, (AT[0] + 0.99, AT[1]), FAR, 20.0)
    assert stall(explorer, 151, FAR, (AT[0] + 0.99, AT[1])) == 200
    explorer = corridor(30.0)
    explorer.stalled(0, AT, FAR, 20.0)
    explorer.stalled(150, (AT[0] + 1.0, AT[1]), FAR, 20.0)
    assert stall(explorer, 151, FAR, (AT[0] + 1.0, AT[1])) == 350


def to_and_fro(explorer: Explorer, remaining_m: list[float], targets: list[Place] | None = None) -> int | None:
    """Move 2 m at every second; returns the second at which that counts as a stall."""
    for second, left in enumerate(remaining_m):
        at = (AT[0] + 2.0 * (second % 2), AT[1])
        if explorer.stalled(10 * second, at, targets[second] if targets else FAR, left):
            return second
    return None


def test_who_came_no_metre_nearer_in_sixty_seconds_has_stalled() -> None:
    assert to_and_fro(corridor(30.0), [20.0] * 90) == 60
    assert to_and_fro(corridor(30.0), [20.0] * 30 + [19.01] * 60) == 60
    assert to_and_fro(corridor(30.0), [20.0] * 30 + [19.0] * 70) == 90
    other: Place = (FAR[0] + 0.5, FAR[1])
    assert to_and_fro(corridor(30.0), [20.0] * 100, [FAR] * 30 + [other] * 70) == 90, "another target, another minute"


def test_the_limits_start_anew_after_a_rest() -> None:
    explorer = corridor(30.0)
    explorer.stalled(0, AT, FAR, 20.0)
    explorer.rest()
    assert stall(explorer, 190, FAR) == 390


def test_the_stall_rule_can_be_switched_off() -> None:
    explorer = corridor(30.0, rules=Exploring(stall=False))
    assert not any(explorer.stalled(tick, AT, FAR, 20.0) for tick in range(1000))


@pytest.mark.parametrize(("share", "seconds"), [(0.0, 30.0), (0.5, 60.0), (1.0, 90.0)])
def test_a_taboo_lasts_a_minute_more_or_less(share: float, seconds: float) -> None:
    explorer = corridor(30.0, rng=Fixed(share=share))
    at = stall(explorer, 0, FAR)
    last = at + round(10 * seconds)
    assert explorer.is_taboo(last - 1, FAR)
    assert not explorer.is_taboo(last, FAR)


def test_a_taboo_is_twice_as_long_for_each_earlier_stall_in_a_row_four_times_at_most() -> None:
    explorer = corridor(30.0)
    tick, lasted = 0, []
    for _ in range(7):
        tick = stall(explorer, tick, FAR)
        end = tick
        while explorer.is_taboo(end, FAR):
            end += 1
            assert end < tick + 20_000
        lasted.append((end - tick) / 600)
        tick = end
    assert lasted == [1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


def test_a_row_ends_after_forty_new_cells() -> None:
    explorer = corridor(30.0)
    stall(explorer, 0, FAR)
    explorer.discovered(39)
    assert explorer.stalls == 1
    explorer.discovered(1)
    assert explorer.stalls == 0
    stall(explorer, 1000, FAR)
    explorer.discovered(39)
    assert explorer.stalls == 1, "counted from zero"


def test_frontiers_within_eight_metres_are_taboo() -> None:
    explorer = corridor(30.0)
    tick = stall(explorer, 0, FAR)
    near, far = (FAR[0] + 8.0, FAR[1]), (FAR[0] + 8.1, FAR[1])
    assert explorer.allowed(tick, np.array([FAR, near, far])).tolist() == [False, False, True]


def test_a_robot_turns_to_what_is_not_taboo_and_if_all_is_to_the_best_of_all() -> None:
    explorer = corridor(14.0, 40.0)
    near = choice(explorer, 0)
    tick = stall(explorer, 0, near)
    far = choice(explorer, tick)
    assert far[0] > near[0] + 8.0
    tick = stall(explorer, tick, far)
    assert choice(explorer, tick) == near


# -- retreat -----------------------------------------------------------------------------------------------------------


def cornered(stalls: int, rng: Fixed) -> tuple[Explorer, int]:
    """After so many stalls at the only frontier."""
    explorer = corridor(30.0, rng=rng)
    tick = 0
    for _ in range(stalls):
        tick = stall(explorer, tick, FAR) + 1
    return explorer, tick


@pytest.mark.parametrize(
    ("stalls", "number", "share", "seconds"),
    [(3, 0.49, 0.0, 30.0), (3, 0.49, 1.0, 90.0), (5, 0.0, 0.5, 60.0), (2, 0.0, 0.5, None), (3, 0.5, 0.5, None)],
)
def test_after_three_stalls_in_a_row_half_of_the_robots_walk_back(
    stalls: int, number: float, share: float, seconds: float | None
) -> None:
    explorer, tick = cornered(stalls, Fixed(number, share))
    assert explorer.retreat_until == -1
    target = choice(explorer, tick)
    assert math.dist(target, FAR) < 2.0
    assert explorer.retreat_until == (-1 if seconds is None else tick + round(10 * seconds))


def test_nobody_walks_back_while_a_frontier_is_not_taboo() -> None:
    explorer = corridor(30.0, 50.0)
    tick = 0
    for _ in range(4):
        tick = stall(explorer, tick, FAR) + 1
    assert choice(explorer, tick)[0] > 45.0
    assert explorer.retreat_until == -1


def test_who_walks_back_goes_to_the_ms_and_then_to_its_target_again() -> None:
    team = Team([(1.0, 1.0, 59.0, 5.0)], {0: (3.0, 3.0), 1: (9.0, 3.0)}, dark=[(57.0, 1.0, 59.0, 5.0)])
    team.run(5)
    assert team.velocity_m_s(1)[0] > 0.27
    team.policy(1).explorer.retreat_until = team.tick + 3
    seen = []
    for _ in range(5):
        team.step()
        seen.append(team.velocity_m_s(1)[0] > 0.0)
    assert seen == [False, False, False, True, True]


def test_a_relay_does_not_walk_back_for_what_it_met_as_a_search_robot() -> None:
    at = {0: (3.0, 3.0), 1: (9.0, 3.0), 2: (15.0, 3.0)}
    team = Team([(1.0, 1.0, 59.0, 5.0)], at, dark=[(57.0, 1.0, 59.0, 5.0)])
    team.run(10)
    assert team.cls(1) is Cls.RR
    team.policy(1).explorer.retreat_until = team.tick + 10
    team.step()
    assert team.velocity_m_s(1)[0] > 0.0
