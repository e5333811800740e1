"""Robots with bodies give way: each rule on and off, and short missions in corridors and doors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.body import Action
from agents.found_bodies import Found
from agents.giving_way import GivingWay
from agents.vds import STILL
from deploy.simulation import Simulation
from tests.helpers.errands import walked
from tests.helpers.stage import Stage
from world.grid import FREE, OCCUPIED
from world.terms import Cls, Mode, Place

RADIUS_M = 0.25
EAST: Place = (0.5, 0.0)


def stage(**switches: float | bool) -> tuple[Stage, GivingWay]:
    """Robot 1 in the open at (10, 10), with its body."""
    made = Stage(bodies_m=RADIUS_M, giving_way=switches)
    made.body.at = 10.0, 10.0
    return made, GivingWay(made.body)


def action(velocity: Place, cls: Cls = Cls.SR, mode: Mode = Mode.WALK) -> Action:
    return Action(velocity, mode, cls, (20.0, 10.0))


def test_nobody_near_changes_nothing() -> None:
    made, giving = stage()
    made.other(2, (16.0, 10.0))
    assert giving.velocity(action(EAST)) == EAST


def test_points_give_no_way() -> None:
    made = Stage()
    made.body.at = 10.0, 10.0
    made.other(2, (10.3, 10.0))
    assert GivingWay(made.body).velocity(action(EAST)) == EAST
    assert GivingWay(made.body).velocity(action(STILL)) == STILL


@pytest.mark.parametrize("on", [True, False])
def test_who_walks_goes_round_to_the_right(on: bool) -> None:
    made, giving = stage(avoid=on)
    made.other(2, (10.55, 10.0))
    x, y = giving.velocity(action(EAST))
    if on:
        assert y < 0.0
        assert x > -0.2
    else:
        assert (x, y) == EAST


@pytest.mark.parametrize("on", [True, False])
def test_who_stands_makes_room(on: bool) -> None:
    made, giving = stage(avoid=on)
    made.other(2, (10.55, 10.0))
    velocity = giving.velocity(action(STILL, mode=Mode.WAIT))
    if on:
        assert velocity[0] < -0.2
        made.body.at = 9.6, 10.0
        assert giving.velocity(action(STILL, mode=Mode.WAIT)) == STILL, "far enough away"
    else:
        assert velocity == STILL


@pytest.mark.parametrize(("ours", "theirs", "backs"), [(3, 1, True), (1, 3, False), (2, 2, False)])
def test_who_is_held_up_by_one_with_right_of_way_backs_off(ours: int, theirs: int, backs: bool) -> None:
    made, giving = stage(back_s=0.5)
    made.nms(4)
    made.body.router.table.set_route(0, made.freshness(ours), 4)
    ran = []
    for tick in range(1, 14):
        made.body.tick = tick
        made.other(2, (10.5, 10.0), ms_freshness=made.freshness(theirs))
        ran.append(giving.velocity(action(EAST))[0])
    assert (min(ran) < -0.3) == backs


def held_up(made: Stage, giving: GivingWay, ticks: int) -> None:
    for _ in range(ticks):
        made.body.tick += 1
        giving.velocity(action(EAST))


@pytest.mark.parametrize("on", [True, False])
def test_a_silent_body_is_remembered_for_a_while_and_planned_around(on: bool) -> None:
    made, giving = stage(go_round=on, remember_s=10.0)
    body = made.body
    version = body.map.version
    held_up(made, giving, 6)
    assert bool(body.found) == on
    assert body.map.version == version, "it is no wall"
    a, b = body.map.geometry.index(10.0, 10.0), body.map.geometry.index(12.0, 10.0)
    path = [body.map.geometry.center(cell) for cell in body.planner.path(a, b)]
    ((x, y),) = body.found.places() if on else ((10.5, 10.0),)
    assert (x, y) == pytest.approx((10.5, 10.0))
    assert (min(math.dist(place, (x, y)) for place in path) >= 0.5) == on
    assert body.planner.clear_line(body.at, (12.0, 10.0)) != on
    body.at = 10.0, 9.0
    held_up(made, giving, 1)
    body.tick += 101
    held_up(made, giving, 1)
    assert not body.found
    assert body.planner.clear_line(body.at, (12.0, 10.0))


def test_a_silent_body_stands_where_it_was_heard_last() -> None:
    made, giving = stage()
    made.other(2, (10.4, 10.3))
    del made.body.router.neighbors.by_id[2]
    held_up(made, giving, 6)
    assert made.body.found.places() == [pytest.approx((10.4, 10.3), abs=1e-4)]


def test_a_neighbor_that_speaks_is_no_silent_body() -> None:
    made, giving = stage(avoid=False)
    for _ in range(8):
        made.other(2, (10.5, 10.0))
        held_up(made, giving, 1)
    assert not made.body.found


def test_a_line_that_leads_away_from_a_body_is_clear() -> None:
    found = Found(Stage().body.map.geometry, 0.5)
    found.add((10.0, 10.0), 50)
    assert found.clear((10.4, 10.0), (12.0, 10.0))
    assert not found.clear((9.0, 10.0), (12.0, 10.0))
    assert found.clear((9.0, 10.6), (12.0, 10.6))
    found.add((10.05, 10.0), 80)
    assert len(found.places()) == 1, "the same one"
    found.forget(79)
    assert found
    found.forget(80)
    assert not found


@pytest.mark.parametrize("on", [True, False])
def test_a_relay_does_not_wait_in_a_door(on: bool) -> None:
    made, giving = stage(clear_doors=on)
    own = made.body.map
    grid = own.cells.reshape(own.geometry.rows, own.geometry.cols)
    grid[16:30, 20] = OCCUPIED  # x 10 to 10.5, y 8 to 15
    grid[22:24, 20] = FREE  # y 11 to 12: a door
    own.apply(np.zeros(0, np.uint32), np.zeros(0, np.int8))
    made.body.at = 10.25, 11.5
    made.other(2, (5.0, 11.5), cls=Cls.RR)
    made.nms(2)
    for tick in range(1, 60):
        made.body.tick = tick
        made.other(2, (5.0, 11.5), cls=Cls.RR)
        vx, vy = giving.velocity(action(STILL, Cls.RR, Mode.WAIT))
        made.body.at = made.body.at[0] + 0.1 * vx, made.body.at[1] + 0.1 * vy
    gone = math.dist(made.body.at, (10.25, 11.5))
    assert (gone > 0.5) == on
    assert own.clear_line(*made.body.at, 5.0, 11.5), "in sight of its NMS"
    made.body.at = 10.25, 11.5
    made.body.tick = 200
    assert giving.velocity(action(STILL, Cls.SR, Mode.WAIT)) == STILL, "who searches may wait there"


# Missions


def until(
    mission: Iterator[tuple[Simulation, NDArray[np.float64]]],
    done: Callable[[NDArray[np.float64]], bool],
    *,
    happens: bool = True,
) -> Simulation:
    """Go on until the places of the robots are such; check whether they ever are."""
    for simulation, places in mission:  # noqa: B007  # used after the loop
        if done(places):
            break
    assert done(places) == happens, (places.tolist(), simulation.world.final()["blocked_moves"])
    return simulation


@pytest.mark.parametrize("width_m", [1.0, 0.7])
@pytest.mark.parametrize("on", [True, False])
def test_two_meet_in_a_corridor(width_m: float, on: bool) -> None:
    half = width_m / 2
    walls = [[7.0, 4.0, 13.0, 5.0 - half], [7.0, 5.0 + half, 13.0, 6.0]]
    errands = {1: [(30.0, (17.0, 5.0))], 2: [(0.0, (17.0, 5.0)), (30.0, (3.0, 5.0))]}
    changes = {"floor_plan.walls": walls, "rules.giving_way.avoid": on, "rules.giving_way.go_round": on}
    mission = walked("two_rooms", errands, 90.0, **changes)
    passed = until(mission, lambda places: bool(places[0, 0] > 15.0 and places[1, 0] < 5.0), happens=on)
    assert on or passed.world.final()["blocked_moves"]["live"] > 400


@pytest.mark.parametrize("on", [True, False])
def test_a_robot_passes_one_that_waits_in_a_door(on: bool) -> None:
    errands = {1: [(0.0, (7.25, 5.0))], 2: [(25.0, (11.0, 5.0))]}
    changes = {"floor_plan.walls": [[7.0, 1.5, 7.5, 2.5]], "rules.giving_way.avoid": on}
    until(walked("two_doors", errands, 60.0, **changes), lambda places: bool(places[1, 0] > 10.5), happens=on)


@pytest.mark.parametrize("on", [True, False])
def test_a_dead_body_in_a_door_is_walked_around(on: bool) -> None:
    other_door, far_from_it = (6.5, 2.0), (4.0, 7.5)
    errands = {1: [(0.0, other_door), (15.0, far_from_it), (32.0, (11.0, 5.0))], 2: [(0.0, (7.25, 5.0))]}
    changes = {"fault": ["kill:2@20"], "rules.giving_way.go_round": on}
    mission = walked("two_doors", errands, 80.0, **changes)
    simulation = until(mission, lambda places: bool(places[0, 0] > 10.5), happens=on)
    blocked = simulation.world.final()["blocked_moves"]
    assert blocked["dead"] > 0
    assert blocked["live"] == 0
