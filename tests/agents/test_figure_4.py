"""The paper's chain transforms itself (Fig. 4), as a scripted situation [paper 4.7, 3.5, 1.2].

Two blind corridors start at a junction north of the MS. The chain MS - B - C - A stands in the western one, whose end
is dark. It turns out to be a wall. A, the search robot, then chooses the dark end of the eastern corridor. All three
turn around; once C has a path to the MS without B, nobody names B any more: B becomes a search robot, and leads.

A third dark place, south of the MS, is what B would choose if it chose for itself, since A has taken the eastern one.
"""

from __future__ import annotations

import pytest

from tests.helpers.team import Team
from world.terms import STATION, Cls

MS, B, C, A = STATION, 1, 2, 3
FLOOR = [(38.0, 1.0, 42.0, 24.0), (18.0, 20.0, 52.0, 24.0)]
WEST_END, EAST_END, SOUTH_END = (18.0, 20.0, 19.0, 24.0), (51.0, 20.0, 52.0, 24.0), (38.0, 1.0, 42.0, 2.0)
AT = {MS: (40.0, 18.0), B: (35.0, 22.0), C: (29.0, 22.0), A: (23.0, 22.0)}


@pytest.fixture
def team() -> Team:
    """The western corridor is about to be found blind."""
    team = Team(FLOOR, AT, dark=[WEST_END, EAST_END, SOUTH_END])
    team.run(20)
    assert [team.nms(node) for node in (B, C, A)] == [MS, B, C]
    assert [team.cls(node) for node in (B, C, A)] == [Cls.RR, Cls.RR, Cls.SR]
    assert all(inside(team, node, WEST_END) for node in (B, C, A))
    team.see_wall(WEST_END)
    return team


def inside(team: Team, node: int, end: tuple[float, float, float, float]) -> bool:
    """Whether a robot's target lies at the end of a corridor."""
    target = team.policy(node).target
    return target is not None and abs(target[0] - (end[0] + end[2]) / 2) < 4.0 and end[1] - 4 < target[1] < end[3] + 4


def test_the_relays_have_the_new_target_within_two_ticks(team: Team) -> None:
    team.step()
    assert [inside(team, node, EAST_END) for node in (A, C, B)] == [True, False, False]
    team.step()
    assert [inside(team, node, EAST_END) for node in (A, C, B)] == [True, True, False]
    team.step()
    assert [inside(team, node, EAST_END) for node in (A, C, B)] == [True, True, True]


def test_the_relay_that_was_passed_becomes_a_search_robot_with_the_same_target_and_keeps_to_it(team: Team) -> None:
    team.run(3)
    target = team.policy(B).target
    while team.cls(B) is Cls.RR:
        team.step(walking=[A, B, C])
        assert team.policy(B).target == pytest.approx(target, abs=1e-4)
    assert (team.nms(C), team.cls(C)) == (MS, Cls.RR)
    while team.at[B][0] < 47.0:
        team.step(walking=[A, B, C])
        assert inside(team, B, EAST_END)
    assert team.cls(B) is Cls.SR
    assert team.at[B][1] > 20.0
