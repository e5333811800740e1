"""The lidar against a slow march along each beam, and straight lines through the grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.grid.lines import line_of_sight, walls_crossed
from world.lidar import Caster, cast

GEOMETRY = GridGeometry(20, 24, 0.5, -3.0, 7.0)
STEP_M = 0.001


def random_walls(seed: int, share: float = 0.08) -> NDArray[np.bool_]:
    return np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < share


def wall_at(occupied: NDArray[np.bool_], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Reference look-up: outside the grid is wall."""
    cols = np.floor((x - GEOMETRY.x0_m) / GEOMETRY.resolution_m).astype(int)
    rows = np.floor((y - GEOMETRY.y0_m) / GEOMETRY.resolution_m).astype(int)
    outside = (cols < 0) | (rows < 0) | (cols >= GEOMETRY.cols) | (rows >= GEOMETRY.rows)
    wall: NDArray[np.bool_] = outside | occupied[rows.clip(0, GEOMETRY.rows - 1), cols.clip(0, GEOMETRY.cols - 1)]
    return wall


def march(occupied: NDArray[np.bool_], x: float, y: float, beams: int, range_m: float) -> NDArray[np.float64]:
    """Reference scan: the first wall on a fine walk along each beam."""
    along = np.arange(0.0, range_m, STEP_M)
    ranges = np.full(beams, range_m)
    for i in range(beams):
        angle = 2 * math.pi * i / beams
        hit = wall_at(occupied, x + along * math.cos(angle), y + along * math.sin(angle))
        if hit.any():
            ranges[i] = along[hit.argmax()]
    return ranges


# Off the round numbers: along a grid line, and through a corner, either answer is right.
inside = st.tuples(st.floats(-2.99, 8.9), st.floats(7.01, 16.9)).map(lambda p: (p[0] + 0.01234, p[1] + 0.0321))


@settings(max_examples=60, deadline=None)
@given(inside, st.integers(0, 10_000), st.sampled_from([8, 37, 90]), st.sampled_from([2.0, 4.3, 8.0]))
def test_ranges_equal_a_fine_march(place: tuple[float, float], seed: int, beams: int, range_m: float) -> None:
    occupied = random_walls(seed)
    assume(not wall_at(occupied, np.array(place[:1]), np.array(place[1:]))[0])
    ranges = cast(occupied, GEOMETRY, *place, beams, range_m)
    reference = march(occupied, *place, beams, range_m)
    assert ranges.shape == (beams,)
    # The march may step over a corner thinner than its step, but never reports a wall too early.
    assert (ranges <= reference + 1e-9).all()
    clipped = ranges < reference - 2 * STEP_M
    for i in np.flatnonzero(clipped):
        angle = 2 * math.pi * i / beams
        aside = np.array([-math.sin(angle), math.cos(angle)]) * 2 * STEP_M
        x, y = place[0] + ranges[i] * math.cos(angle), place[1] + ranges[i] * math.sin(angle)
        near = [(x + s * aside[0] + f * aside[1], y + s * aside[1] - f * aside[0]) for s in (-1, 1) for f in (-1, 1)]
        assert wall_at(occupied, *np.array(near).T).any(), "a hit without any wall near it"


def test_ranges_are_exact_to_the_surface() -> None:
    occupied = np.zeros((GEOMETRY.rows, GEOMETRY.cols), bool)
    occupied[:, 10] = True  # x from 2.0 to 2.5
    ranges = cast(occupied, GEOMETRY, 0.13, 12.0, 8, 8.0)
    assert ranges[0] == pytest.approx(2.0 - 0.13, abs=1e-12)
    assert ranges[1] == pytest.approx((2.0 - 0.13) * math.sqrt(2), abs=1e-12)
    assert ranges[4] == pytest.approx(0.13 + 3.0, abs=1e-12)
    assert ranges[6] == pytest.approx(5.0, abs=1e-12)


def test_nothing_within_range_gives_the_range() -> None:
    free = np.zeros((100, 100), bool)
    geometry = GridGeometry(100, 100, 0.5)
    assert (cast(free, geometry, 25.0, 25.0, 180, 8.0) == 8.0).all()


def test_a_place_on_a_cell_border_belongs_to_the_upper_cell() -> None:
    occupied = np.zeros((10, 10), bool)
    occupied[4, 3] = True
    geometry = GridGeometry(10, 10, 0.5)
    ranges = Caster(occupied, geometry, 8, 3.0).cast(2.0, 2.25)
    assert ranges[4] == 0.0
    assert ranges[0] == 3.0


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(inside, inside), min_size=1, max_size=20), st.integers(0, 10_000))
def test_walls_crossed_is_symmetric(pairs: list[tuple[tuple[float, float], tuple[float, float]]], seed: int) -> None:
    occupied = random_walls(seed, 0.3)
    a, b = np.array([p for p, _ in pairs]), np.array([q for _, q in pairs])
    assert (walls_crossed(occupied, GEOMETRY, a, b) == walls_crossed(occupied, GEOMETRY, b, a)).all()


@settings(max_examples=100, deadline=None)
@given(inside, inside, st.integers(0, 10_000))
def test_walls_crossed_counts_runs(a: tuple[float, float], b: tuple[float, float], seed: int) -> None:
    occupied = random_walls(seed, 0.3)
    crossed = int(walls_crossed(occupied, GEOMETRY, np.array([a]), np.array([b]))[0])
    along = np.linspace(0.0, 1.0, 20_001)
    wall = wall_at(occupied, a[0] + along * (b[0] - a[0]), a[1] + along * (b[1] - a[1]))
    runs = int(wall[0]) + np.count_nonzero(wall[1:] & ~wall[:-1])
    # A walk in steps can miss a corner that is cut by less than a step, never find a wall that is not there.
    if crossed != runs:
        corners = corners_near(a, b)
        assert corners, f"{crossed} walls, the walk found {runs}"
    assert line_of_sight(occupied, GEOMETRY, a, b) == (crossed == 0)


def corners_near(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether the segment passes a cell corner within 2 mm."""
    p, q = np.array(a), np.array(b)
    direction = q - p
    length = float(np.hypot(*direction))
    if length < 0.01:
        return True
    cols = np.arange(GEOMETRY.cols + 1) * GEOMETRY.resolution_m + GEOMETRY.x0_m
    rows = np.arange(GEOMETRY.rows + 1) * GEOMETRY.resolution_m + GEOMETRY.y0_m
    x, y = np.meshgrid(cols, rows)
    away = np.abs((x - p[0]) * direction[1] - (y - p[1]) * direction[0]) / length
    return bool((away < 0.002).any())


def test_one_wall_however_thick_and_none_beside_it() -> None:
    occupied = np.zeros((GEOMETRY.rows, GEOMETRY.cols), bool)
    occupied[:, 8:12] = True
    occupied[:, 15] = True
    a = np.array([[-2.0, 10.0], [-2.0, 10.0], [-2.0, 8.0], [1.5, 10.0]])
    b = np.array([[8.0, 10.2], [4.0, 10.0], [-2.0, 16.0], [1.6, 10.0]])
    assert walls_crossed(occupied, GEOMETRY, a, b).tolist() == [2, 1, 0, 1]
    assert walls_crossed(occupied, GEOMETRY, np.empty((0, 2)), np.empty((0, 2))).tolist() == []
