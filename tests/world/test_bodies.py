"""Robots are discs: moves end at the first contact, whatever the order of the robots, and stops are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.scenario import ScenarioError, load
from tests.helpers.hand_driven import Run, config
from world.bodies import Bodies, first_contacts
from world.config import Fault
from world.grid import GridGeometry
from world.motion import move

RADIUS_M = 0.25
APART_M = 2 * RADIUS_M


def gaps(places: np.ndarray) -> np.ndarray:
    away = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    return away[np.triu_indices(len(places), 1)]


def crowd(generator: np.random.Generator, walls: np.ndarray, geometry: GridGeometry, most: int) -> np.ndarray:
    """Free places that are apart, as near to one another as chance has it."""
    places: list[np.ndarray] = []
    for place in geometry.centers(generator.permutation(np.flatnonzero(~walls))):
        at = place + generator.uniform(-0.12, 0.12, 2)
        if len(places) < most and all(math.dist(at, other) >= APART_M for other in places):
            places.append(at)
    return np.array(places)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 24), st.sampled_from([0.3, 2.0, 8.0]))
def test_bodies_never_overlap_and_their_order_does_not_matter(seed: int, robots: int, top: float) -> None:
    generator = np.random.default_rng(seed)
    walls = generator.random((16, 16)) < 0.15
    walls[[0, -1]] = walls[:, [0, -1]] = True
    geometry = GridGeometry(16, 16, 0.25, -2.0, 1.0)
    places = crowd(generator, walls, geometry, robots)
    shuffled = generator.permutation(len(places))
    bodies, others = Bodies(RADIUS_M, walls, geometry), Bodies(RADIUS_M, walls, geometry)
    live = [bool(x) for x in generator.random(len(places)) < 0.8]
    for _ in range(30):
        middle = places.mean(axis=0)
        velocity = generator.normal(0.0, top, places.shape) + 3.0 * (middle - places)  # all push into the middle
        velocity[~np.array(live)] = 0.0
        pairs = [(float(x), float(y)) for x, y in velocity]
        wanted = move(walls, geometry, places, pairs, top)
        after = bodies.stop(places, wanted, live)
        again = others.stop(places[shuffled], wanted[shuffled], [live[k] for k in shuffled])
        assert np.array_equal(after[shuffled], again)
        assert gaps(after).min(initial=9.0) >= APART_M - 1e-9
        cells = np.floor((after - (-2.0, 1.0)) / 0.25).astype(int)
        assert not walls[cells[:, 1], cells[:, 0]].any()
        places = after
    assert bodies.blocked_moves == others.blocked_moves


def meet(
    starts: list[tuple[float, float]], ends: list[tuple[float, float]]
) -> tuple[list[list[float]], list[tuple[int, int]]]:
    places, contacts = first_contacts(np.array(starts), np.array(ends), APART_M)
    return places.round(9).tolist(), sorted(contacts)


def test_two_that_meet_head_on_stop_in_the_middle() -> None:
    assert meet([(0, 0), (1, 0)], [(0.4, 0), (0.6, 0)]) == ([[0.25, 0], [0.75, 0]], [(0, 1), (1, 0)])


def test_the_faster_one_stops_behind_the_slower() -> None:
    assert meet([(0, 0), (0.6, 0)], [(0.3, 0), (0.7, 0)]) == ([[0.15, 0], [0.7, 0]], [(0, 1)])


def test_a_row_moves_as_one() -> None:
    starts = [(0.5 * k, 0.0) for k in range(5)]
    ends = [(x + 0.1, y) for x, y in starts]
    assert meet(starts, ends) == ([[round(x, 9), 0] for x, _ in ends], [])


def test_a_row_stops_at_its_head() -> None:
    starts = [(0.5 * k, 0.0) for k in range(3)]
    assert meet(starts, [(0.1, 0), (0.6, 0), (1.0, 0)]) == ([[0, 0], [0.5, 0], [1.0, 0]], [(0, 1), (1, 2)])


def test_who_goes_along_the_edge_or_away_is_free() -> None:
    starts = [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)]
    ends = [(0.0, 0.0), (0.5, 0.3), (-0.1, 0.6)]
    assert meet(starts, ends) == ([[0, 0], [0.5, 0.3], [-0.1, 0.6]], [])


def test_who_was_stopped_stops_others() -> None:
    # 1 meets 0 early; 2 comes to where 1 would have left.
    starts = [(0.0, 0.0), (0.55, 0.0), (0.6, 0.6)]
    places, contacts = meet(starts, [(0.2, 0.0), (0.3, 0.0), (0.6, 0.2)])
    assert {(0, 1), (1, 0), (2, 1)} == set(contacts)
    assert gaps(np.array(places)).min() >= APART_M - 1e-8


def test_points_pass_through_one_another() -> None:
    run = Run(config(2))
    run.velocity = {1: (0.5, 0.0), 2: (-0.5, 0.0)}
    run.until(30)
    assert run.world.begin().positions.xy_m[1][0] > 4.0
    assert run.world.final()["blocked_moves"] == {"live": 0, "dead": 0}


def test_stops_are_counted_by_whose_body_it_was() -> None:
    made = config(2, body_radius_m=RADIUS_M, faults=(Fault("kill", 3.0, "2"),))
    run = Run(made)
    run.velocity = {1: (0.5, 0.0)}
    run.until(29)
    live = run.world.final()["blocked_moves"]["live"]
    assert live == 20  # 0.5 m in ten ticks
    assert run.world.final()["blocked_moves"]["dead"] == 0
    run.until(39)
    assert run.world.final()["blocked_moves"] == {"live": live, "dead": 10}
    x, _ = run.world.begin().positions.xy_m[1]
    assert x == pytest.approx(4.0 - APART_M)


@pytest.mark.parametrize("changes", [{}, {"station.start_radius_m": 4.0}])
def test_starts_do_not_overlap(changes: dict[str, float]) -> None:
    starts = load("three_cells", {"robots": 12, "body_radius_m": RADIUS_M} | changes).arena.starts_m
    assert gaps(starts).min() > APART_M


@pytest.mark.parametrize("changes", [{}, {"station.start_radius_m": 2.0}])
def test_no_room_for_starts_is_told_in_a_line(changes: dict[str, float]) -> None:
    with pytest.raises(ScenarioError, match=r"no free .* for robot .* of 120.*, with body_radius_m = 0.25$"):
        load("three_cells", {"robots": 120, "body_radius_m": RADIUS_M} | changes)
