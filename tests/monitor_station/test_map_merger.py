"""The merged map is a sum of evidence: any order and any repetition of reports gives the same map."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config import RobotConfig
from agents.messages import ScanReport
from monitor_station.map_merger import MapMerger
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

GEOMETRY = GridGeometry(5, 6)


def merger_of(noise_m: float, zone_m: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)) -> MapMerger:
    config = RobotConfig(0, 1, GEOMETRY, (0.5, 0.5), zone_m, 20.0, 8.0, 180, 0.0, 40.0, 3.0, lidar_noise_m=noise_m)
    return MapMerger(config)


def report(origin: int, number: int, votes: dict[int, int], incarnation: int = 0) -> ScanReport:
    cells = np.array(list(votes), np.uint32)
    return ScanReport(origin, incarnation, number, cells, np.array(list(votes.values()), np.int8))


votes = st.dictionaries(st.integers(0, GEOMETRY.size - 1), st.integers(0, 1), max_size=12)
sources = st.tuples(st.integers(1, 3), st.integers(0, 1), st.integers(1, 4))


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(sources, votes, max_size=12), st.sampled_from([0.0, 0.05, 0.4]), st.integers(0, 1 << 30))
def test_any_order_and_any_repetition_of_reports_gives_one_map(
    said: dict[tuple[int, int, int], dict[int, int]], noise_m: float, seed: int
) -> None:
    reports = [report(origin, number, seen, incarnation) for (origin, incarnation, number), seen in said.items()]
    rng = random.Random(seed)
    maps = []
    for _ in range(3):
        heard = reports + rng.choices(reports, k=rng.randrange(6)) if reports else []
        rng.shuffle(heard)
        merger, followed = merger_of(noise_m), merger_of(noise_m).odds
        for one in heard:
            change = merger.take(one)
            if change is not None:
                followed[change.cells] = change.odds
        assert followed.tobytes() == merger.odds.tobytes(), "whoever follows the changes has the same map"
        assert merger.merged == len(reports)
        maps.append((merger.odds.tobytes(), merger.cells.tobytes(), merger.acks()))
    assert maps[0] == maps[1] == maps[2]


def test_one_exact_hit_is_a_wall_for_good_and_one_noisy_hit_is_not() -> None:
    for noise_m, after in ((0.0, OCCUPIED), (0.05, FREE)):
        merger = merger_of(noise_m)
        merger.take(report(1, 1, {20: 1}))
        assert merger.cells[20] == OCCUPIED
        for number in range(2, 5):
            merger.take(report(1, number, {20: 0}))
        assert merger.cells[20] == after


def test_states_revert_and_the_change_says_which() -> None:
    merger = merger_of(0.4)
    seen = []
    for number, hit in enumerate((0, 1, 1, 0, 0), 1):
        change = merger.take(report(1, number, {20: hit}))
        assert change is not None
        assert change.turned.tolist() == [20]
        seen.append(int(merger.cells[20]))
    assert seen == [FREE, UNKNOWN, OCCUPIED, UNKNOWN, FREE]


@pytest.mark.parametrize("noise_m", [0.0, 0.05, 0.4])
def test_counts_are_clamped_only_when_read(noise_m: float) -> None:
    """A hundred misses are not forgotten: what came first does not decide."""
    first, last = merger_of(noise_m), merger_of(noise_m)
    for number in range(1, 101):
        first.take(report(1, number, {20: 0}))
        last.take(report(2, number, {20: 1 if number <= 3 else 0}))
    for number in range(1, 4):
        first.take(report(2, number, {20: 1}))
    for number in range(4, 101):
        first.take(report(2, number, {20: 0}))
    for number in range(1, 101):
        last.take(report(1, number, {20: 0}))
    assert first.odds[20] == last.odds[20]
    assert first.cells[20] == (OCCUPIED if noise_m == 0.0 else FREE)


def test_the_safety_zone_is_settled_before_the_first_report() -> None:
    merger = merger_of(0.05)
    zone = GEOMETRY.rectangle(0.0, 0.0, 1.0, 1.0)
    assert (merger.cells[zone] == FREE).all()
    merger.take(report(1, 1, {int(zone[0]): 1}))
    assert merger.cells[zone[0]] == FREE
    assert np.count_nonzero(merger.cells != UNKNOWN) == len(zone)
