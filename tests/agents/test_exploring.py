"""A robot's own map, its paths, and its choice of frontiers."""

from __future__ import annotations

import heapq
import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config import Exploring, RobotConfig
from agents.explorer import Explorer, score
from agents.own_map import OwnMap
from agents.planner import Planner
from agents.walker import Walker
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.lidar import Caster

SIDE = 24
GEOMETRY = GridGeometry(SIDE, SIDE)


def config(geometry: GridGeometry = GEOMETRY) -> RobotConfig:
    return RobotConfig(1, 1, geometry, (1.0, 1.0), (0.0, 0.0, 0.0, 0.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0)


def map_of(free: np.ndarray) -> OwnMap:
    own = OwnMap(config(GridGeometry(*free.shape)))
    own.apply(np.arange(free.size, dtype=np.uint32), np.where(free.ravel(), -1, 1).astype(np.int8))
    return own


def random_rooms(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    free = np.zeros((SIDE, SIDE), bool)
    for _ in range(6):
        r, c = rng.integers(1, SIDE - 8, 2)
        h, w = rng.integers(2, 9, 2)
        free[r : min(r + h, SIDE - 1), c : min(c + w, SIDE - 1)] = True
    return free


def slow_lengths(free: np.ndarray, source: int) -> dict[int, float]:
    """Dijkstra by the book, with the rule for diagonal steps spelled out."""
    done: dict[int, float] = {}
    heap = [(0.0, source)]
    while heap:
        length, cell = heapq.heappop(heap)
        if cell in done:
            continue
        done[cell] = length
        row, col = divmod(cell, SIDE)
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if (dr or dc) and 0 <= r < SIDE and 0 <= c < SIDE and free[r, c] and free[row, c] and free[r, col]:
                    heapq.heappush(heap, (length + 0.5 * math.hypot(dr, dc), r * SIDE + c))
    return done


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_map_that_becomes_known_bit_by_bit_plans_like_a_known_one(seed: int) -> None:
    free = random_rooms(seed)
    cells = np.flatnonzero(free.ravel())
    rng = random.Random(seed)
    order = cells.tolist()
    rng.shuffle(order)
    own = OwnMap(config())
    planner = Planner(own)
    for part in np.array_split(np.array(order), 5):
        own.apply(part.astype(np.uint32), np.full(len(part), -1, np.int8))
        planner.reach(int(part[0]))
    wall = np.array(order[: len(order) // 10])
    own.apply(wall.astype(np.uint32), np.ones(len(wall), np.int8))
    free.ravel()[wall] = False
    source = order[-1]
    truth = slow_lengths(free, source)
    reach = planner.reach(source)
    for cell in cells.tolist():
        assert reach.length_m(cell) == pytest.approx(truth.get(cell, math.inf))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_scan_never_takes_a_wall_for_free_nor_free_space_for_a_wall(seed: int) -> None:
    free = random_rooms(seed)
    rng = np.random.default_rng(seed)
    caster = Caster(~free, GEOMETRY, 180, 8.0)
    own = OwnMap(config())
    cells = np.flatnonzero(free.ravel())
    for cell in rng.choice(cells, 5).tolist():
        x, y = GEOMETRY.center(cell)
        x, y = x + rng.uniform(-0.24, 0.24), y + rng.uniform(-0.24, 0.24)
        changed, values, _ = own.integrate(x, y, caster.cast(x, y))
        assert (own.cells[changed] == values).all()
        assert own.cells[cell] == FREE
    known = own.cells != UNKNOWN
    assert ((own.cells == FREE)[known] == free.ravel()[known]).all()


def test_frontiers_are_free_cells_next_to_unknown_ones() -> None:
    own = OwnMap(config())
    own.apply(GEOMETRY.rectangle(2, 2, 5, 5).astype(np.uint32), np.full(36, -1, np.int8))
    assert own.frontiers().tolist() == [
        c
        for c in GEOMETRY.rectangle(2, 2, 5, 5).tolist()
        if not {c - 1, c + 1, c - SIDE, c + SIDE} <= set(GEOMETRY.rectangle(2, 2, 5, 5).tolist())
    ]
    assert [c for c in range(GEOMETRY.size) if own.is_frontier(c)] == own.frontiers().tolist()


def test_score_is_utility_minus_cost_discounted_by_others() -> None:
    rules = Exploring()
    frontiers = np.array([(0.0, 0.0), (4.0, 0.0), (20.0, 0.0)])
    lengths = np.array([1.0, 2.0, 3.0])
    assert score(frontiers, lengths, np.zeros((0, 2)), rules).tolist() == [19.0, 18.0, 17.0]
    one = score(frontiers, lengths, np.array([(0.0, 0.0)]), rules)
    assert one.tolist() == [-1.0, 20 * 0.5 - 2, 17.0]
    two = score(frontiers, lengths, np.array([(0.0, 0.0), (4.0, 0.0)]), rules)
    assert two.tolist() == [-1.0, -2.0, 17.0]


def test_a_stall_makes_the_target_taboo_and_progress_ends_the_row() -> None:
    free = np.zeros((SIDE, SIDE), bool)
    free[2:6, 2:22] = True
    own = map_of(free)
    own.cells[own.cells == OCCUPIED] = UNKNOWN
    rules = Exploring(taboo_radius_m=3.0)
    explorer = Explorer(rules, own, Planner(own), random.Random(1))
    at = (1.75, 1.75)
    chosen = explorer.select(0, at, np.zeros((0, 2)))
    assert chosen is not None
    target = chosen[0]
    stalled = [tick for tick in range(400) if explorer.stalled(tick, at, target, 3.0)]
    assert stalled[0] == 200, "no 1 m move in 20 s"
    other = explorer.select(stalled[0], at, np.zeros((0, 2)))
    assert other is not None
    assert math.dist(other[0], target) > 3.0


def test_a_walker_reaches_its_goal_around_a_corner() -> None:
    free = np.zeros((SIDE, SIDE), bool)
    free[2:20, 2:5] = True
    free[17:20, 2:20] = True
    own = map_of(free)
    walker = Walker(own, Planner(own), same_goal_m=0.05)
    at, goal = (1.75, 1.25), (9.25, 9.25)
    for tick in range(600):
        vx, vy = walker.velocity(tick, at, goal, 0.3)
        assert math.hypot(vx, vy) <= 0.3 + 1e-9
        at = at[0] + vx * 0.1, at[1] + vy * 0.1
        assert free.ravel()[own.geometry.index(*at)], "walked into a wall"
        if math.dist(at, goal) < 0.05:
            break
    assert math.dist(at, goal) < 0.05
    assert tick * 0.1 * 0.3 < 1.15 * slow_lengths(free, own.geometry.index(1.75, 1.25))[own.geometry.index(*goal)]
