"""The compiled loops give the same bits as their oracles, and are never used when they are out of date."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys
from array import array
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bus.built
from agents.config import RobotConfig
from agents.evidence import SensorModel
from agents.forwarding_table import ROW, ForwardingTable, freshness_of
from agents.own_map import OwnMap
from agents.planner import Planner
from bus.built import LOOPS, StaleLoopsError
from bus.codec import WireError
from medium.messages import UNLIMITED, Inbox
from tests import ROOT
from tests.oracles import inbox as oracle_inbox
from tests.oracles import lidar as oracle_lidar
from tests.oracles import lines as oracle_lines
from tests.oracles import planner as oracle_planner
from tests.oracles.forwarding_table import OracleTable
from tests.oracles.own_map import OracleMap
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.grid.lines import line_of_sight, walls_crossed
from world.lidar import Caster
from world.terms import NOBODY

GEOMETRY = GridGeometry(30, 36, 0.5, -3.0, 7.0)

property_test = settings(max_examples=150, deadline=None)


def robot_config(noise_m: float = 0.0) -> RobotConfig:
    return RobotConfig(
        1, 1, GEOMETRY, (0.0, 10.0), (-1.0, 9.0, 1.0, 11.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0, lidar_noise_m=noise_m
    )


inside = st.tuples(st.floats(-2.99, 14.99), st.floats(7.01, 21.99))
anywhere = st.tuples(st.floats(-6.0, 18.0), st.floats(4.0, 25.0))


@property_test
@given(inside, st.integers(0, 10_000), st.sampled_from([8, 37, 180]), st.sampled_from([2.0, 4.3, 8.0]))
def test_scans(place: tuple[float, float], seed: int, beams: int, reach_m: float) -> None:
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.08
    expected = oracle_lidar.cast(occupied, GEOMETRY, *place, beams, reach_m)
    np.testing.assert_array_equal(Caster(occupied, GEOMETRY, beams, reach_m).cast(*place), expected)


@property_test
@given(st.lists(inside, min_size=1, max_size=6), st.integers(0, 10_000), st.sampled_from([0.0, 0.1, 0.6]))
def test_what_scans_show(places: list[tuple[float, float]], seed: int, noise_m: float) -> None:
    """Of a map that is told in between what others saw, so that what was settled counts again."""
    config = robot_config(noise_m)
    told = SensorModel(config).settled
    noise = np.random.default_rng(seed + 1)
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.01 * (seed % 9)
    caster = Caster(occupied, GEOMETRY, config.lidar_beams, config.lidar_range_m)
    ours, theirs = OwnMap(config), OracleMap(config)
    for place in places:
        ranges = (caster.cast(*place) + noise.normal(0.0, noise_m, config.lidar_beams)).clip(0.0, 8.0)
        for a, b in zip(ours.integrate(*place, ranges), theirs.integrate(*place, ranges), strict=True):
            np.testing.assert_array_equal(a, b)
        cells = noise.choice(GEOMETRY.size, 20, replace=False).astype(np.uint32)
        odds = noise.integers(-told, told + 1, 20).astype(np.int8)
        ours.apply(cells, odds)
        theirs.apply(cells, odds)
        np.testing.assert_array_equal(ours.frontiers(), theirs.frontiers())
    np.testing.assert_array_equal(ours.cells, theirs.cells)


@property_test
@given(st.lists(st.tuples(anywhere, anywhere), max_size=8), st.integers(0, 10_000))
def test_walls_on_segments(segments: list[tuple[tuple[float, float], tuple[float, float]]], seed: int) -> None:
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.2
    a, b = np.array(segments, np.float64).reshape(-1, 2, 2).transpose(1, 0, 2)
    expected = oracle_lines.walls_crossed(occupied, GEOMETRY, a, b)
    np.testing.assert_array_equal(walls_crossed(occupied, GEOMETRY, a, b), expected)
    assert [line_of_sight(occupied, GEOMETRY, *segment) for segment in segments] == (expected == 0).tolist()


@property_test
@given(anywhere, anywhere, st.integers(0, 10_000))
def test_lines_over_the_own_map(a: tuple[float, float], b: tuple[float, float], seed: int) -> None:
    ours, theirs = OwnMap(robot_config()), OracleMap(robot_config())
    generator = np.random.default_rng(seed)
    ours.cells[:] = theirs.cells[:] = generator.integers(-1, OCCUPIED + 1, ours.cells.size)
    assert ours.obstacles(*a, *b) == theirs.obstacles(*a, *b)
    assert ours.clear_line(*a, *b) == (theirs.obstacles(*a, *b) == 0)
    for cell in generator.integers(0, ours.cells.size, 50).tolist():
        assert ours.is_frontier(cell) == theirs.is_frontier(cell)


@property_test
@given(
    st.integers(0, 1 << 30),
    st.sampled_from([math.inf, 3.0, 8.5]),
    st.floats(0.0, 0.5),
    st.lists(st.one_of(anywhere, st.tuples(st.sampled_from([0.0, 3.25, 6.0]), st.just(9.5))), max_size=4),
)
def test_searches(seed: int, limit_m: float, walls: float, places: list[tuple[float, float]]) -> None:
    rng = np.random.default_rng(seed)
    own = OwnMap(robot_config())
    planner = Planner(own)
    for part in np.array_split(rng.permutation(own.cells.size), 3):
        own.apply(part.astype(np.uint32), np.where(rng.random(len(part)) < walls, 1, -1).astype(np.int8))
        source, *goals = (planner.nearest_free(cell) for cell in rng.integers(0, own.cells.size, 4).tolist())
        reach = planner.reach(source, limit_m)
        expected = oracle_planner.lengths_m(own, source, limit_m)
        np.testing.assert_array_equal(reach.lengths_m(np.arange(own.cells.size)), expected)
        for cell in reach.reached().tolist():
            assert reach.path(cell) == oracle_planner.path(own, expected, cell)
        for x_m, y_m in places:
            assert reach.length_near_m(x_m, y_m) == oracle_planner.length_near_m(own, expected, x_m, y_m)
        expected = oracle_planner.lengths_m(own, source)
        for goal in goals:
            there = oracle_planner.path(own, expected, goal) if expected[goal] < math.inf else []
            assert planner.path(source, goal) == there


@property_test
@given(st.integers(0, 1 << 30))
def test_the_nearest_free_cell_is_the_one_that_was_known_first(seed: int) -> None:
    rng = np.random.default_rng(seed)
    own = OwnMap(robot_config())
    planner = Planner(own)
    order: list[int] = []
    for part in np.array_split(rng.permutation(own.cells.size), 4):
        own.apply(part.astype(np.uint32), np.where(rng.random(len(part)) < 0.7, 1, -1).astype(np.int8))
        order += sorted(set(np.flatnonzero(own.cells == FREE).tolist()) - set(order))
        for cell in rng.integers(0, own.cells.size, 5).tolist():
            row, col = divmod(cell, GEOMETRY.cols)
            free = [other for other in order if own.cells[other] == FREE]
            nearest = min(free, key=lambda n: (n // GEOMETRY.cols - row) ** 2 + (n % GEOMETRY.cols - col) ** 2)
            assert planner.nearest_free(cell) == (cell if own.cells[cell] == FREE else nearest)


def fill(table: ForwardingTable, seed: int) -> tuple[array[int], bytes]:
    """Next hops before the tick, and what a neighbor advertises: now and then with a row that can't be."""
    rng = random.Random(seed)
    for dst in rng.sample(range(12), 8):
        table.set_route(dst, freshness_of(2 * rng.randrange(4), rng.randrange(5)), rng.randrange(12))
        table.set_inherent(dst, rng.randrange(2), (rng.uniform(0, 50), 1.0), (2.0, 3.0))
    rows = []
    for dst in [3, *rng.sample(range(12), 8)]:
        finite = rng.random() < 0.8
        hop = rng.randrange(1, 5) if dst != 3 or rng.random() < 0.02 else 0
        freshness = freshness_of(2 * rng.randrange(4), hop) if finite else (2 * rng.randrange(4) + 1) << 8
        if rng.random() < 0.02:
            freshness ^= 256
        if rng.random() < 0.02:
            freshness += rng.choice([255 << 56, 4 << 9])
        rows.append(ROW.pack(dst if rng.random() > 0.01 else rng.choice([12, 40_000]), freshness, rng.randbytes(18)))
    rows.append(rng.choice(rows))
    before = array("h", [rng.choice([2, 3, NOBODY]) for _ in range(rng.choice([9, 12]))])
    return before, b"".join(rows)[: None if rng.random() > 0.02 else -1]


@property_test
@given(st.integers(0, 1 << 30), st.sampled_from([0, NOBODY]))
def test_merged_tables(seed: int, sticky: int) -> None:
    outcomes = []
    for table in (ForwardingTable(1, 11), OracleTable(1, 11)):
        before, rows = fill(table, seed)
        try:
            outcome: object = table.merge(3, rows, before, sticky, 8)
        except WireError as error:
            outcome = str(error)
        hops = [table.next_hop_to(dst) for dst in table.known]
        outcomes.append((outcome, table.known, hops, table.search_robots(), table.advertised()))
    assert outcomes[0] == outcomes[1]


@property_test
@given(st.lists(st.dictionaries(st.integers(0, 1079), st.integers(-1, 1), max_size=30), max_size=4))
def test_cells_from_elsewhere(chunks: list[dict[int, int]]) -> None:
    ours, theirs = OwnMap(robot_config()), OracleMap(robot_config())
    for chunk in chunks:
        cells, values = np.array(list(chunk), np.uint32), np.array(list(chunk.values()), np.int8)
        theirs.apply(cells, values)
        ours.apply(cells, values)
    np.testing.assert_array_equal(ours.cells, theirs.cells)
    assert (ours.version, ours.reverted) == (theirs.version, theirs.reverted)
    np.testing.assert_array_equal(np.sort(ours.changes(0)[0]), np.sort(theirs.changes(0)[0]))


def test_cells_outside_are_refused_and_nothing_is_taken_over() -> None:
    own = OwnMap(robot_config())
    with pytest.raises(IndexError):
        own.apply(np.array([5, own.cells.size], np.uint32), np.array([0, 0], np.int8))
    assert own.cells[5] == UNKNOWN


frames_heard = st.lists(st.tuples(st.integers(0, 33_000), st.floats(allow_infinity=False), st.binary(max_size=9)))


@property_test
@given(st.integers(0, 2**31 - 1), frames_heard, st.integers(0, UNLIMITED), st.data())
def test_inboxes(tick: int, heard: list[tuple[int, float, bytes]], room_bytes: int, data: st.DataObject) -> None:
    inbox = Inbox(tick, tuple(heard), room_bytes, room_bytes // 5)
    packed = oracle_inbox.encode(inbox)
    assert inbox.encode() == packed
    packed = packed[: data.draw(st.integers(max(len(packed) - 3, 12), len(packed)))]
    outcomes: list[object] = []
    for decode in (Inbox.decode, oracle_inbox.decode):
        try:
            outcomes.append(decode(packed))
        except WireError as error:
            outcomes.append(str(error))
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("name", LOOPS)
def test_loops_that_were_built_from_another_source_are_refused(name: str) -> None:
    with pytest.raises(StaleLoopsError, match=rf"{name} is out of date: run `make setup`"):
        bus.built.check(name, "0" * 64)
    bus.built.check(name, bus.built.digest(name))


def test_every_file_of_loops_is_checked_when_it_is_imported() -> None:
    assert LOOPS
    words = (
        "import bus.built, importlib, sys\n"
        "asked = []\n"
        "bus.built.check = lambda name, built_from: asked.append(name)\n"
        "for name in sys.argv[1:]: importlib.import_module(name)\n"
        "print(*sorted(asked))\n"
    )
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    said = subprocess.run([sys.executable, "-c", words, *LOOPS], env=env, capture_output=True, text=True, check=True)
    assert tuple(said.stdout.split()) == LOOPS


@property_test
@given(st.integers(0, 1 << 30), st.sampled_from([0.0, 0.1]), st.sampled_from([0.0, 0.02]))
def test_a_search_that_follows_the_map_is_as_one_made_anew(seed: int, walls: float, closed: float) -> None:
    """On a map larger than the part that searches look at, and with cells that are free no more."""
    rng = np.random.default_rng(seed)
    own = OwnMap(replace(robot_config(), geometry=GridGeometry(90, 150)))
    planner = Planner(own)
    reach, (_, seen) = planner.reach(planner.nearest_free(0)), own.changes(0)
    for part in np.array_split(rng.permutation(own.cells.size)[: own.cells.size * 9 // 10], 4):
        own.apply(part.astype(np.uint32), (rng.random(len(part)) < walls).astype(np.int8))
        shut = np.flatnonzero(rng.random(own.cells.size) < closed)
        own.apply(shut.astype(np.uint32), np.full(len(shut), OCCUPIED, np.int8))
        changed, seen = own.changes(seen)
        source = planner.nearest_free(0)
        if source != reach.source or not reach.follow(own.cells, changed):
            reach = planner.reach(source)
        expected = oracle_planner.lengths_m(own, source)
        np.testing.assert_array_equal(reach.lengths_m(np.arange(own.cells.size)), expected)
        x_m, y_m = rng.uniform(0.0, 75.0, 2).tolist()
        assert reach.length_near_m(x_m, y_m) == oracle_planner.length_near_m(own, expected, x_m, y_m)
