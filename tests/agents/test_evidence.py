"""Hits and misses in a robot's own map: what settles, what is reported again, what counts once, and what reverts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agents.config import RobotConfig
from agents.evidence import SCANS_OF_A_PLACE, SensorModel
from agents.own_map import OwnMap
from agents.own_reports import OwnReports
from agents.planner import Planner
from agents.walker import Walker
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.lidar import Caster

GEOMETRY = GridGeometry(20, 40, 0.25)
BEAMS = 180


def config(lidar_noise_m: float = 0.0, pose_noise_m: float = 0.0) -> RobotConfig:
    return RobotConfig(
        1, 1, GEOMETRY, (1.0, 1.0), (0.0, 0.0, 0.0, 0.0), 20.0, 3.0, BEAMS, 0.0, 40.0, 3.0,
        lidar_noise_m=lidar_noise_m, pose_noise_m=pose_noise_m,
    )  # fmt: skip


def room() -> np.ndarray:
    """A room of 9.5 m by 4.5 m with a wall across half of it."""
    occupied = np.ones((GEOMETRY.rows, GEOMETRY.cols), bool)
    occupied[1:-1, 1:-1] = False
    occupied[1:9, 20] = True
    return occupied


@pytest.mark.parametrize(("noise_m", "settled"), [(0.0, 1), (0.05, 6), (0.5, 6)])
def test_a_settled_cell_is_reported_again_only_when_it_is_contradicted(noise_m: float, settled: int) -> None:
    own = OwnMap(config(noise_m))
    miss = own._sensors.miss
    cell = np.array([50], np.int64)
    reported = [len(own._weigh(cell, -miss)[0]) for _ in range(8)]
    assert sum(reported) == math.ceil(settled / miss)
    assert reported == sorted(reported, reverse=True)
    assert len(own._weigh(cell, own._sensors.worth)[0]) == 1, "a hit contradicts"
    if noise_m:
        assert len(own._weigh(cell, -miss)[0]) == 1, "and is then outvoted"
        assert own.cells[50] == FREE
    else:
        assert len(own._weigh(cell, -miss)[0]) == 0, "what an exact sensor hit is wall"
        assert own.cells[50] == OCCUPIED


def test_exact_scans_of_a_place_report_nothing_twice() -> None:
    own, caster = OwnMap(config()), Caster(room(), GEOMETRY, BEAMS, 3.0)
    ranges = caster.cast(2.0, 2.0)
    cells, values, discovered = own.integrate(2.0, 2.0, ranges)
    assert len(cells) == len(set(cells.tolist()))
    assert discovered == np.count_nonzero(values == FREE) > 100
    assert [len(part) for part in own.integrate(2.0, 2.0, ranges)[:2]] == [0, 0]


def _hit_again(own: OwnMap, cell: int) -> None:
    own._weigh(np.array([cell], np.int64), own._sensors.worth)


def _told(own: OwnMap, cell: int) -> None:
    own.apply(np.array([cell], np.uint32), np.ones(1, np.int8))


def _forgotten(own: OwnMap, cell: int) -> None:
    own.forget(np.array([cell], np.uint32), np.full(1, FREE, np.int8))


@pytest.mark.parametrize("contradict", [_hit_again, _told, _forgotten])
def test_scans_look_again_at_a_settled_place_where_a_score_changed(contradict: Callable[[OwnMap, int], None]) -> None:
    own, cell, x_m = OwnMap(config(0.5)), GEOMETRY.index(3.5, 2.5), 2.0
    nothing_met = np.full(BEAMS, 3.0)

    def scan() -> list[int]:
        nonlocal x_m
        x_m = 2.0 if x_m > 2.0 else 2.4
        counted: list[int] = own.integrate(x_m, 2.5, nothing_met)[0].tolist()
        return counted

    while cell in scan():
        pass
    assert all(cell not in scan() for _ in range(3))
    contradict(own, cell)
    assert cell in scan()


def test_a_noisy_robot_that_stands_still_does_not_repeat_itself() -> None:
    rng = np.random.default_rng(1)
    own, caster = OwnMap(config(0.05, 0.05)), Caster(room(), GEOMETRY, BEAMS, 3.0)

    def scan(x: float, y: float) -> int:
        ranges = (caster.cast(x, y) + rng.normal(0.0, 0.05, BEAMS)).clip(0.0, 3.0)
        return len(own.integrate(x + rng.normal(0.0, 0.05), y + rng.normal(0.0, 0.05), ranges)[0])

    assert [scan(2.0, 2.0) > 0 for _ in range(6)] == [k < SCANS_OF_A_PLACE for k in range(6)]
    assert scan(2.6, 2.0) > 0


@pytest.mark.parametrize("noise_m", [0.02, 0.05, 0.08])
def test_noise_makes_few_free_cells_walls_and_walls_free(noise_m: float) -> None:
    rng = np.random.default_rng(2)
    occupied = room()
    own, caster = OwnMap(config(noise_m, noise_m)), Caster(occupied, GEOMETRY, BEAMS, 3.0)
    for _ in range(400):
        x, y = rng.uniform(0.6, 4.4) + rng.choice([0.0, 4.9]), rng.uniform(0.6, 4.4)
        ranges = (caster.cast(x, y) + rng.normal(0.0, noise_m, BEAMS)).clip(0.0, 3.0)
        own.integrate(x + rng.normal(0.0, noise_m), y + rng.normal(0.0, noise_m), ranges)
    truth = occupied.ravel()
    assert np.mean(own.cells[~truth] != FREE) < 0.01
    assert np.mean(own.cells[truth & (own.cells != UNKNOWN)] == FREE) < 0.02


def test_own_evidence_counts_until_the_map_contains_it_and_not_on_top_of_it() -> None:
    own, reports = OwnMap(config(0.5)), OwnReports()
    cell, cells = np.array([50], np.int64), np.array([50], np.uint32)
    own._weigh(cell, -1)
    reports.add(1, cells, np.zeros(1, np.int8))
    own.apply(cells, np.array([2], np.int8))  # without the own miss
    assert own._scores[50] == 1
    assert reports.contained(0, 0, 7) == []
    assert reports.contained(1, 9, 7) == [], "acknowledged, but by a version that is still on its way"
    own.apply(cells, np.array([1], np.int8))  # with it
    for report in reports.contained(1, 9, 9):
        own.forget(*report)
    assert (own._scores[50], own.cells[50]) == (1, OCCUPIED)
    assert reports.contained(1, 9, 99) == []


def test_reports_are_contained_in_their_order_and_stale_acknowledgements_do_not_matter() -> None:
    reports = OwnReports()
    for number in (1, 2, 4):
        reports.add(number, np.array([number], np.uint32), np.zeros(1, np.int8))
    assert reports.contained(2, 20, 10) == []
    assert reports.contained(1, 5, 10) == []
    assert reports.contained(4, 30, 25)[-1][0].tolist() == [2]
    assert [cells.tolist() for cells, _ in reports.contained(3, 30, 30)] == [[4]]


def walled_off() -> tuple[OwnMap, Planner]:
    own = OwnMap(config(0.5))
    free = np.zeros((GEOMETRY.rows, GEOMETRY.cols), bool)
    free[2:10, 2:30] = True
    own.apply(np.flatnonzero(free).astype(np.uint32), np.full(free.sum(), -1, np.int8))
    return own, Planner(own)


def test_searches_and_frontiers_follow_states_that_revert() -> None:
    own, planner = walled_off()
    column = np.arange(2, 10) * GEOMETRY.cols + 15
    near, far = 5 * GEOMETRY.cols + 5, 5 * GEOMETRY.cols + 25
    before = planner.reach(near).length_m(far)
    version, frontiers = own.version, own.frontiers().tolist()
    own.apply(column.astype(np.uint32), np.full(8, 1, np.int8))
    assert (own.version, own.reverted) == (version + 1, 8)
    assert planner.reach(near).length_m(far) == math.inf
    assert planner.nearest_free(int(column[3])) != column[3]
    own.apply(column.astype(np.uint32), np.full(8, 0, np.int8))
    assert set(own.frontiers().tolist()) > set(frontiers) - set(column.tolist())
    assert own.is_frontier(int(column[3]) - 1), "what is unknown again is to be looked at again"
    own.apply(column.astype(np.uint32), np.full(8, -1, np.int8))
    assert (planner.reach(near).length_m(far), own.frontiers().tolist()) == (before, frontiers)
    assert planner.nearest_free(int(column[3])) == column[3]


def test_a_path_that_the_map_cuts_is_planned_again() -> None:
    own, planner = walled_off()
    walker = Walker(own, planner, same_goal_m=0.05)
    at, goal = (1.0, 2.3), (7.0, 2.3)
    assert walker.velocity(0, at, goal, 0.5) == pytest.approx((0.5, 0.0))
    column = np.arange(4, 10) * GEOMETRY.cols + 15  # the lower end stays open
    own.apply(column.astype(np.uint32), np.full(6, 1, np.int8))
    vx, vy = walker.velocity(1, (1.05, 2.3), goal, 0.5)
    assert vy < -0.05, "around the wall"
    assert walker.velocity(2, (1.05 + 0.1 * vx, 2.3 + 0.1 * vy), goal, 0.5) == pytest.approx((vx, vy), abs=0.01)


def test_who_has_another_sensor_reads_counts_in_another_way() -> None:
    exact, noisy, coarse = (SensorModel(config(noise_m)) for noise_m in (0.0, 0.05, 0.5))
    assert (exact.exact, exact.settled, exact.miss) == (True, 1, 1)
    assert (noisy.exact, noisy.worth, noisy.miss) == (False, 1, 3)
    assert (coarse.exact, coarse.worth, coarse.miss) == (False, 1, 1)
    assert exact.into_wall_m < noisy.into_wall_m < coarse.into_wall_m == 0.125
