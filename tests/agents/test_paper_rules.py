"""The rules of the paper, each on a floor plan on which another rule gives another answer [paper 4.1 to 5.10]."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from agents.config import Exploring, Moving, Reporting, Rules
from agents.robot import Robot
from tests.helpers.team import BEAMS, GEOMETRY, RANGE_M, Team
from world.grid import FREE
from world.messages import Sense
from world.terms import NOBODY, STATION, Cls, Mode, Place

MS, C, D, E, F, G = STATION, 1, 2, 3, 4, 5
WALK_M_S, TRACE_M_S = 1.0 / 3.6, 2.0 / 3.6
LONG = [(1.0, 1.0, 59.0, 5.0)]
"""One corridor, along x."""
FOLDED = [(1.0, 1.0, 32.0, 5.0), (29.0, 1.0, 32.0, 12.0), (1.0, 9.0, 32.0, 12.0)]
"""Two corridors side by side, joined at x = 30: 7 m apart through the wall, 50 m and more on foot."""


def on_line(*gaps_m: float) -> dict[int, Place]:
    """MS, C, E (and D behind it) in a corridor, with these gaps."""
    x = 3.0 + np.cumsum([0.0, *gaps_m])
    return {node: (float(place), 3.0) for node, place in zip((MS, C, E, D), x, strict=False)}


# -- class [paper 4.1, 4.2] --------------------------------------------------------------------------------------------


def test_a_robot_whose_inv_is_empty_is_a_search_robot_and_any_other_a_relay() -> None:
    team = Team(LONG, on_line(7.0, 7.0, 7.0))
    team.run(10)
    routers = {node: robot.body.router for node, robot in team.robots.items()}
    assert {node: router.inv for node, router in routers.items()} == {C: [E], E: [D], D: []}
    assert {node: team.cls(node) for node in routers} == {C: Cls.RR, E: Cls.RR, D: Cls.SR}


def test_all_know_class_and_location_of_all_and_neighbors_alone_the_nms() -> None:
    team = Team(LONG, on_line(7.0, 7.0, 7.0))
    team.run(10)
    table, heard = team.robots[C].body.router.table, team.robots[C].body.router.neighbors.by_id
    assert table.cls(D) == Cls.SR
    assert table.cls(E) == Cls.RR
    assert table.location_m(D) == pytest.approx((24.0, 3.0), abs=1e-4)
    assert sorted(heard) == [MS, E]
    assert heard[E].nms == C


def test_a_relay_that_nobody_names_is_a_search_robot_again_after_a_second_and_a_relay_at_once() -> None:
    team = Team(LONG, on_line(7.0, 7.0))
    team.run(10)
    router = team.robots[C].body.router
    assert (team.cls(C), router.inv) == (Cls.RR, [E])
    team.silent = {E}
    while router.inv:
        assert team.cls(C) is Cls.RR
        team.step()
    empty = team.tick - 1  # the first tick at which inv was empty
    while team.cls(C) is Cls.RR:
        team.step()
    assert team.tick - 1 == empty + 10
    team.silent = set()
    while not router.inv:
        team.step()
    assert team.cls(C) is Cls.RR


# -- selection of the MSR [paper 4.4 to 4.6, 4.8] ----------------------------------------------------------------------


def test_rule_1_discards_search_robots_beyond_the_nms_however_far_they_are() -> None:
    """F is at the end of another chain, 63 m from the MS on foot; E, of the own chain, is 19 m away."""
    team = Team(FOLDED, {MS: (3.0, 3.0), G: (9.0, 3.0), C: (15.5, 3.0), E: (22.5, 3.0), F: (3.0, 10.5)})
    team.run(30)
    assert (team.nms(C), team.nms(E)) == (G, C)
    table = team.robots[C].body.router.table
    assert table.search_robots() == [E, F]
    assert table.next_hop_to(F) == G
    far_e, far_f = team.robots[C].body.ms_distance([(22.5, 3.0), (3.0, 10.5)])
    assert far_f > far_e + 30.0
    assert team.policy(C).msr == E
    # G sees both through C and beside it: none of them lies beyond its NMS, so it takes the farthest.
    assert team.policy(G).msr == F


def test_rule_2_takes_the_farthest_along_the_way_not_as_the_crow_flies() -> None:
    """F is behind the wall, 11 m from the MS and 55 m on foot; E is 14 m away on both counts."""
    at = {MS: (3.0, 3.0), C: (9.0, 3.0), E: (16.5, 3.0), F: (11.0, 10.5)}
    team = Team(FOLDED, at)
    team.run(30)
    assert (team.nms(E), team.nms(F)) == (C, C)
    assert math.dist(at[E], at[MS]) > math.dist(at[F], at[MS]) + 2.0
    assert team.policy(C).msr == F
    # Where the corridors are one room the crow's flight is the way, and E is the farthest.
    room = Team([(1.0, 1.0, 32.0, 12.0)], at)
    room.run(30)
    assert room.policy(C).msr == E


def test_the_way_is_measured_on_the_map_as_explored_so_far() -> None:
    """The corridors meet at x = 30, but nobody has seen that yet: F counts from the nearest place that is reached."""
    at = {MS: (3.0, 3.0), C: (9.0, 3.0), E: (16.9, 3.0), F: (10.0, 10.3)}
    bend = (29.0, 1.0, 32.0, 12.0)
    team = Team(FOLDED, at, dark=[bend])
    team.run(30)
    assert team.policy(C).msr == E
    team.see_floor(bend)
    team.run(60)  # the way is measured every 5 s at most, and compared once a second
    assert team.policy(C).msr == F


def test_distances_are_compared_once_a_second_while_the_msr_stays_eligible() -> None:
    at = {MS: (3.0, 3.0), C: (9.0, 3.0), E: (16.5, 3.0), F: (13.0, 4.5)}
    team = Team(LONG, at)
    team.run(30)
    assert team.policy(C).msr == E
    team.at[E], team.at[F] = at[F], at[E]
    changed = []
    for _ in range(20):
        before = team.policy(C).msr
        team.step()
        if team.policy(C).msr != before:
            changed.append(team.tick - 1)
    assert len(changed) == 1
    assert (changed[0] + C) % 10 == 0
    # One that is discarded is replaced at once, at whatever tick.
    team.run(4)
    team.silent = {F}
    while F in team.robots[C].body.router.table.search_robots():
        assert team.policy(C).msr == F
        team.step()
    assert team.policy(C).msr == E


def test_an_msr_is_replaced_only_by_one_that_is_two_metres_farther() -> None:
    team = Team(LONG, {MS: (3.0, 3.0), C: (9.0, 3.0), E: (15.0, 3.0), F: (14.0, 4.5)})
    team.run(30)
    assert team.policy(C).msr == E
    team.at[F] = (16.5, 3.0)
    team.run(30)
    assert team.policy(C).msr == E
    team.at[F] = (17.5, 3.0)
    team.run(30)
    assert team.policy(C).msr == F


def test_a_relay_that_rule_1_leaves_nobody_has_no_msr_and_keeps_its_target() -> None:
    team = Team(LONG, on_line(7.0, 7.0, 7.0), dark=[(57.0, 1.0, 59.0, 5.0)])
    team.run(20)
    target = team.policy(C).target
    assert team.policy(C).msr == D
    assert target is not None
    assert target[0] > 50.0
    # No SR is left: E, the only one that names C, says that it is named by D, and D is gone.
    team.robots[E].policy.classifier.cls = Cls.RR
    team.robots[E].policy.classifier.step = lambda *_: Cls.RR  # type: ignore[method-assign]  # a relay for good
    team.policy(E).target = (40.0, 3.0)  # of no concern to C, since E is no SR
    team.policy(E).choose_msr = lambda: NOBODY  # type: ignore[method-assign]
    team.silent = {D}
    team.run(20)
    assert team.robots[C].body.router.table.search_robots() == []
    assert team.robots[C].body.router.table.target_m(E) == pytest.approx((40.0, 3.0), abs=1e-4)
    assert (team.cls(C), team.policy(C).msr, team.policy(C).target) == (Cls.RR, NOBODY, target)


def test_a_search_robot_has_no_msr() -> None:
    """E finds a shorter way past C, and goes on searching."""
    team = Team(LONG, on_line(5.0, 5.0))
    team.run(10)
    assert (team.nms(E), team.policy(C).msr) == (C, E)
    team.at[E] = (9.0, 3.0)
    team.run(20)
    assert (team.nms(E), team.cls(C)) == (MS, Cls.SR)
    assert E in team.robots[C].body.router.table.search_robots()
    assert team.policy(C).msr == NOBODY


# -- behavior [paper 5.5 to 5.10] --------------------------------------------------------------------------------------


def behaviors(*gaps_m: float, rules: Rules | None = None) -> dict[int, tuple[Mode, float]]:
    """Mode and velocity along x of C, a relay, and E, a search robot with a target far to the east."""
    team = Team(LONG, on_line(*gaps_m), dark=[(57.0, 1.0, 59.0, 5.0)], rules=rules)
    team.run(20)
    assert (team.cls(C), team.cls(E), team.nms(E)) == (Cls.RR, Cls.SR, C)
    assert all(abs(team.velocity_m_s(node)[1]) < 0.12 for node in (C, E))
    return {node: (Mode(team.motions[node].status.mode), round(team.velocity_m_s(node)[0], 1)) for node in (C, E)}


EAST, FAST_EAST, FAST_WEST = round(WALK_M_S, 1), round(TRACE_M_S, 1), -round(TRACE_M_S, 1)


@pytest.mark.parametrize(
    ("d_in_m", "d_out_m", "relay", "search_robot"),
    [
        (7.9, 7.9, (Mode.WALK, EAST), (Mode.WALK, EAST)),
        (7.9, 8.1, (Mode.WALK, EAST), (Mode.INNER, FAST_WEST)),
        (7.9, 8.9, (Mode.WALK, EAST), (Mode.INNER, FAST_WEST)),
        (7.9, 9.1, (Mode.OUTER, FAST_EAST), (Mode.INNER, FAST_WEST)),
        (8.1, 7.9, (Mode.INNER, FAST_WEST), (Mode.WALK, EAST)),
        (8.1, 9.1, (Mode.INNER, FAST_WEST), (Mode.INNER, FAST_WEST)),
    ],
)
def test_the_first_rule_that_applies_decides(
    d_in_m: float, d_out_m: float, relay: tuple[Mode, float], search_robot: tuple[Mode, float]
) -> None:
    """Inner link recovery before outer, outer before walking; a search robot has no outer link."""
    assert behaviors(d_in_m, d_out_m) == {C: relay, E: search_robot}


def test_a_robot_walks_at_one_kilometre_an_hour_and_traces_at_two() -> None:
    team = Team(LONG, on_line(7.0, 9.5), dark=[(57.0, 1.0, 59.0, 5.0)])
    team.run(20)
    assert team.speed_m_s(C) == pytest.approx(TRACE_M_S)
    assert team.speed_m_s(E) == pytest.approx(TRACE_M_S)
    team.at[E] = (16.0, 3.0)
    team.run(3)
    assert team.speed_m_s(C) == pytest.approx(WALK_M_S)
    assert team.speed_m_s(E) == pytest.approx(WALK_M_S)


def test_relays_walk_to_their_target_unless_that_is_switched_off() -> None:
    off = dataclasses.replace(Rules(), moving=Moving(relay_walks=False))
    assert behaviors(7.0, 7.0)[C] == (Mode.WALK, EAST)
    assert behaviors(7.0, 7.0, rules=off) == {C: (Mode.WAIT, 0.0), E: (Mode.WALK, EAST)}
    assert behaviors(7.0, 9.1, rules=off)[C] == (Mode.OUTER, FAST_EAST)


def test_outer_link_recovery_is_for_the_next_hop_to_the_msr() -> None:
    """D hangs by a side branch 9.5 m away; E, between C and its MSR, is near, so the link that counts is not weak."""
    team = Team(
        [(1.0, 1.0, 59.0, 5.0), (9.0, 1.0, 11.0, 15.0)],
        {MS: (3.0, 3.0), C: (10.0, 3.0), E: (17.0, 3.0), F: (24.0, 3.0), D: (10.0, 12.5)},
        dark=[(57.0, 1.0, 59.0, 5.0)],
    )
    team.run(20)
    assert (team.policy(C).msr, team.policy(C).nmsr) == (F, E)
    assert team.motions[C].status.mode == Mode.WALK
    team.at[E] = (19.2, 3.0)
    team.run(2)
    assert team.motions[C].status.mode == Mode.OUTER


def test_a_silent_neighbor_is_beyond_both_radii() -> None:
    """Rule A [paper 3.7]: after 5 ticks without a frame, 5 ticks before its routes break."""
    for mute, mode in ((MS, Mode.INNER), (E, Mode.OUTER)):
        team = Team(LONG, on_line(7.0, 7.0), dark=[(57.0, 1.0, 59.0, 5.0)])
        team.run(20)
        team.silent = {mute}
        modes = []
        for _ in range(10):
            team.step()
            modes.append(Mode(team.motions[C].status.mode))
        # The last frame was sent at the tick before and is heard at the first of these.
        assert modes == [Mode.WALK] * 5 + [mode] * 5


def test_a_robot_without_a_route_goes_to_where_its_nms_was_and_then_to_the_ms() -> None:
    """Not to the MS at once, and not to where the NMS is now: that one is lost as well, and walks away."""
    team = Team([(1.0, 1.0, 30.0, 18.0)], {MS: (4.0, 10.0), C: (10.0, 6.0), E: (17.0, 6.0)})
    team.run(20)
    assert team.nms(E) == C
    team.silent = {MS}
    while team.motions[E].status.mode != Mode.LOST:
        team.step()
    team.at[C] = (14.0, 13.0)  # within reach of E still, and E hears where it is
    team.run(2)
    assert team.robots[E].body.router.table.location_m(C) == pytest.approx((14.0, 13.0), abs=1e-3)
    assert team.speed_m_s(E) == pytest.approx(TRACE_M_S)
    assert team.velocity_m_s(E) == pytest.approx((-TRACE_M_S, 0.0), abs=0.02)
    while team.at[E][0] > 11.2:
        team.step(walking=[E])
        assert team.at[E][1] == pytest.approx(6.0, abs=0.1)
    team.run(60, walking=[E])
    assert team.at[E] == pytest.approx((8.3, 7.8), abs=0.5)


def test_a_robot_of_a_new_incarnation_stands_while_it_is_quiet() -> None:
    team = Team(LONG, on_line(7.0, 7.0))
    team.run(5)
    born = Robot(team.robots[E].config, type(team.policy(E)), team.robots[E].body.rng, 1, team.tick)
    team.robots[E] = born
    for _ in range(11):
        team.step()
        assert team.motions[E].status.mode == Mode.LOST
        assert team.speed_m_s(E) == 0.0
    team.run(3)
    assert team.motions[E].status.mode != Mode.LOST


# -- target [paper 4.7, 6.1 to 6.3] ------------------------------------------------------------------------------------


def test_a_relay_always_has_the_target_of_its_msr() -> None:
    team = Team(LONG, on_line(7.0, 7.0, 7.0), dark=[(57.0, 1.0, 59.0, 5.0)])
    team.run(20)
    first = team.policy(D).target
    assert first is not None
    assert [team.policy(node).target for node in (C, E)] == [pytest.approx(first, abs=1e-4)] * 2
    team.policy(D).target = (57.25 - 0.5, 1.25)  # another frontier cell, chosen just now
    seen = []
    for _ in range(4):
        team.step()
        seen.append([team.policy(node).target == pytest.approx(team.policy(D).target, abs=1e-4) for node in (E, C)])
    assert seen == [[False, False], [True, False], [True, True], [True, True]]


NICHE = (10.0, 3.0, 12.0, 5.0)


def at_a_niche(rules: Rules | None = None) -> tuple[Team, Place]:
    """C on its way to the dark niche beside it; a second frontier is at the end of the corridor."""
    team = Team(LONG, on_line(5.0), dark=[NICHE, (57.0, 1.0, 59.0, 5.0)], rules=rules)
    team.run(3)
    target = team.policy(C).target
    assert target is not None
    assert team.robots[C].body.map.is_frontier(GEOMETRY.index(*target))
    assert target[0] < 13.0
    team.run(5)
    assert team.policy(C).target == target, "kept on the way"
    return team, target


def test_a_search_robot_chooses_anew_when_it_arrives() -> None:
    team, target = at_a_niche(dataclasses.replace(Rules(), exploring=Exploring(reselect_when_seen=False)))
    team.see_wall(NICHE)
    team.run(5)
    assert team.policy(C).target == target, "no frontier any more, but it did not arrive"
    team.at[C] = (target[0] - 0.26, target[1])
    team.step()
    assert team.policy(C).target == target
    team.at[C] = (target[0] - 0.24, target[1])
    team.step()
    other = team.policy(C).target
    assert other is not None
    assert other[0] > 50.0


def test_a_search_robot_chooses_anew_when_its_target_is_no_frontier_any_more() -> None:
    team, _ = at_a_niche()
    team.see_wall(NICHE)
    team.step()
    other = team.policy(C).target
    assert other is not None
    assert other[0] > 50.0


def test_a_search_robot_leaves_to_others_what_they_have_announced() -> None:
    """E is nearer to the niche and takes it; C would take it, too, if it did not hear of that."""
    at = {MS: (3.0, 3.0), C: (6.0, 2.0), E: (9.0, 4.0)}
    team = Team(LONG, at, dark=[NICHE, (22.0, 1.0, 24.0, 5.0)])
    team.run(5)
    assert (team.cls(C), team.cls(E)) == (Cls.SR, Cls.SR)
    mine, others = team.policy(C).target, team.policy(E).target
    assert mine is not None
    assert others is not None
    team.policy(C).target = None
    team.step()
    assert others[0] < 13.0
    chosen = team.policy(C).target
    assert chosen is not None
    assert chosen[0] > 20.0


# -- what counts as scanned [paper 7.2, 7.4] ---------------------------------------------------------------------------


@pytest.mark.parametrize("kept", [False, True])
def test_a_point_counts_only_while_there_is_a_path_to_the_ms(kept: bool) -> None:
    rules = dataclasses.replace(Rules(), reporting=Reporting(store_and_forward=kept))
    team = Team([], on_line(7.0), dark=[(0.0, 0.0, 60.0, 40.0)], rules=rules)
    robot = team.robots[C]
    scan = np.full(BEAMS, RANGE_M)

    def look() -> tuple[int, int, bool]:
        robot.step(Sense(team.tick, False, 0, *team.at[C], ranges_m=scan), None)
        team.tick += 1
        status = robot._status(robot._action)
        seen = bool(robot.body.map.cells[GEOMETRY.index(team.at[C][0] + 5.0, 3.25)] == FREE)
        return status.reports_made, status.reports_discarded, seen

    assert team.nms(C) == NOBODY
    assert look() == ((1, 0, True) if kept else (0, 1, False))
    team.run(3)
    assert team.nms(C) == MS
    team.at[C] = (11.0, 3.0)
    assert look() == ((2, 0, True) if kept else (1, 1, True))
