"""The compiled loops give the same bits as the Python beside them, and a run that uses them has the same trace."""

from __future__ import annotations

import importlib.util
import math
import os
import random
import shutil
import subprocess
import sys
import sysconfig
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import agents.forwarding_table
import agents.own_map
import agents.planner
import medium.messages
import medium.propagation
import world.geometry
import world.grid
import world.lidar
import world.motion
from agents.config import RobotConfig
from agents.forwarding_table import ROW, ForwardingTable, freshness_of
from agents.own_map import OwnMap
from agents.planner import Planner
from bus.codec import WireError
from deploy.scenario import load
from deploy.simulation import Simulation
from medium.messages import Inbox
from tests.conftest import ROOT
from world.geometry import line_of_sight, walls_crossed
from world.grid import OCCUPIED, UNKNOWN, GridGeometry
from world.lidar import Caster
from world.messages import NOBODY
from world.motion import move

GEOMETRY = GridGeometry(30, 36, 0.5, -3.0, 7.0)
USERS = (
    agents.forwarding_table,
    agents.own_map,
    agents.planner,
    medium.messages,
    medium.propagation,
    world.geometry,
    world.grid,
    world.lidar,
    world.motion,
)

property_test = settings(
    max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.fixture(scope="module")
def kernels(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The extension module, built from source."""
    pytest.importorskip("Cython")
    compiler = str(sysconfig.get_config_var("CC")).split()[0]
    if shutil.which(compiler) is None or not Path(sysconfig.get_path("include"), "Python.h").exists():
        pytest.skip("no C compiler, or no headers of Python")
    place = tmp_path_factory.mktemp("kernels")
    subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--build-lib", str(place), "--build-temp", str(place / "o")],
        cwd=ROOT, env={**os.environ, "VDS_COMPILED": "kernels"}, check=True, capture_output=True, timeout=200,
    )  # fmt: skip
    (built,) = (place / "world").glob("_kernels*.so")
    spec = importlib.util.spec_from_file_location("world._kernels", built)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def using(module: ModuleType | None) -> Iterator[None]:
    """Everybody uses this module's loops, or none."""
    with pytest.MonkeyPatch.context() as patch:
        for user in USERS:
            patch.setattr(user, "kernels", module)
        yield


def robot_config() -> RobotConfig:
    return RobotConfig(1, 1, GEOMETRY, (0.0, 10.0), (-1.0, 9.0, 1.0, 11.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0)


inside = st.tuples(st.floats(-2.99, 14.99), st.floats(7.01, 21.99))
anywhere = st.tuples(st.floats(-6.0, 18.0), st.floats(4.0, 25.0))


@property_test
@given(inside, st.integers(0, 10_000), st.sampled_from([8, 37, 180]), st.sampled_from([2.0, 4.3, 8.0]))
def test_scans_are_equal(
    kernels: ModuleType, place: tuple[float, float], seed: int, beams: int, reach_m: float
) -> None:
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.08
    caster = Caster(occupied, GEOMETRY, beams, reach_m)
    with using(None):
        expected = caster.cast(*place)
    with using(kernels):
        np.testing.assert_array_equal(caster.cast(*place), expected)


@property_test
@given(st.lists(inside, min_size=1, max_size=6), st.integers(0, 10_000))
def test_maps_are_equal(kernels: ModuleType, places: list[tuple[float, float]], seed: int) -> None:
    config = robot_config()
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.08
    caster = Caster(occupied, GEOMETRY, config.lidar_beams, config.lidar_range_m)
    ours, theirs = OwnMap(config), OwnMap(config)
    for place in places:
        ranges = caster.cast(*place)
        with using(None):
            expected = theirs.integrate(*place, ranges)
        with using(kernels):
            found = ours.integrate(*place, ranges)
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(ours.cells, theirs.cells)


@property_test
@given(st.lists(st.tuples(anywhere, anywhere), max_size=8), st.integers(0, 10_000))
def test_walls_are_equal(
    kernels: ModuleType, segments: list[tuple[tuple[float, float], tuple[float, float]]], seed: int
) -> None:
    occupied = np.random.default_rng(seed).random((GEOMETRY.rows, GEOMETRY.cols)) < 0.2
    a, b = np.array(segments, np.float64).reshape(-1, 2, 2).transpose(1, 0, 2)
    with using(None):
        expected = walls_crossed(occupied, GEOMETRY, a, b)
    with using(kernels):
        np.testing.assert_array_equal(walls_crossed(occupied, GEOMETRY, a, b), expected)
    for a, b in segments:
        with using(None):
            free = line_of_sight(occupied, GEOMETRY, a, b)
        with using(kernels):
            assert line_of_sight(occupied, GEOMETRY, a, b) == free


@property_test
@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=6), st.sampled_from([0.5, 9.0]), st.integers(0))
def test_moves_are_equal(
    kernels: ModuleType, velocities: list[tuple[float, float]], top_speed_m_s: float, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    occupied = generator.random((GEOMETRY.rows, GEOMETRY.cols)) < 0.2
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    free = np.flatnonzero(~occupied)
    places = GEOMETRY.centers(generator.choice(free, len(velocities)))
    for _ in range(8):
        with using(None):
            expected = move(occupied, GEOMETRY, places, velocities, top_speed_m_s)
        with using(kernels):
            places = move(occupied, GEOMETRY, places, velocities, top_speed_m_s)
        np.testing.assert_array_equal(places, expected)


@property_test
@given(inside, anywhere, st.integers(0, 10_000))
def test_lines_are_equal(kernels: ModuleType, a: tuple[float, float], b: tuple[float, float], seed: int) -> None:
    own = OwnMap(robot_config())
    own.cells[:] = np.random.default_rng(seed).integers(-1, OCCUPIED + 1, own.cells.size)
    asked = np.random.default_rng(seed).integers(0, own.cells.size, 50).tolist()
    with using(None):
        expected = own.clear_line(*a, *b), own.obstacles(*a, *b), [own.is_frontier(cell) for cell in asked]
    with using(kernels):
        assert (own.clear_line(*a, *b), own.obstacles(*a, *b), [own.is_frontier(cell) for cell in asked]) == expected


@property_test
@given(
    st.integers(0, 1 << 30),
    st.sampled_from([math.inf, 3.0, 8.5]),
    st.floats(0.0, 0.5),
    st.lists(st.one_of(anywhere, st.tuples(st.sampled_from([0.0, 3.25, 6.0]), st.just(9.5))), max_size=4),
)
def test_searches_are_equal(
    kernels: ModuleType, seed: int, limit_m: float, walls: float, places: list[tuple[float, float]]
) -> None:
    rng = np.random.default_rng(seed)
    own = OwnMap(robot_config())
    with using(None):
        theirs = Planner(own)
    with using(kernels):
        ours = Planner(own)
    for part in np.array_split(rng.permutation(own.cells.size), 3):
        own.apply(part.astype(np.uint32), (rng.random(len(part)) < walls).astype(np.int8))
        asked = rng.integers(0, own.cells.size, 4).tolist()
        with using(None):
            nearest = [theirs.nearest_free(cell) for cell in asked]
            source = nearest[0]
            expected = theirs.reach(source, limit_m)
            paths = [expected.path(cell) for cell in expected.reached().tolist()]
            to_there = [theirs.path(source, cell) for cell in nearest]
            near = [expected.length_near_m(*place) for place in places]
        with using(kernels):
            assert [ours.nearest_free(cell) for cell in asked] == nearest
            found = ours.reach(source, limit_m)
            np.testing.assert_array_equal(
                found.lengths_m(np.arange(own.cells.size)), expected.lengths_m(np.arange(own.cells.size))
            )
            assert [found.path(cell) for cell in found.reached().tolist()] == paths
            assert [ours.path(source, cell) for cell in nearest] == to_there
            assert [found.length_near_m(*place) for place in places] == near


def tables(seed: int) -> tuple[ForwardingTable, array[int], bytes]:
    """A table, next hops before the tick, and what a neighbor advertises: now and then with a row that can't be."""
    rng = random.Random(seed)
    table = ForwardingTable(1)
    for dst in rng.sample(range(12), 8):
        table.set_route(dst, freshness_of(2 * rng.randrange(4), rng.randrange(5)), rng.randrange(12))
        table.set_inherent(dst, rng.randrange(2), (rng.uniform(0, 50), 1.0), (2.0, 3.0))
    rows = []
    for dst in [3, *rng.sample(range(12), 8)]:
        finite = rng.random() < 0.8
        freshness = freshness_of(2 * rng.randrange(4), rng.randrange(5)) if finite else (2 * rng.randrange(4) + 1) << 8
        if rng.random() < 0.02:
            freshness ^= 256
        if rng.random() < 0.02:
            freshness += 255 << 56
        rows.append(ROW.pack(dst if rng.random() > 0.01 else 40_000, freshness, rng.randbytes(18)))
    rows.append(rng.choice(rows))
    before = array("h", [rng.choice([2, 3, NOBODY]) for _ in range(rng.choice([9, 12]))])
    return table, before, b"".join(rows)[: None if rng.random() > 0.02 else -1]


@property_test
@given(st.integers(0, 1 << 30), st.sampled_from([0, NOBODY]))
def test_merged_tables_are_equal(kernels: ModuleType, seed: int, sticky: int) -> None:
    outcomes = []
    for module in (None, kernels):
        table, before, rows = tables(seed)
        with using(module):
            try:
                outcome: object = table.merge(3, rows, before, sticky)
            except WireError as error:
                outcome = str(error)
            hops = [table.next_hop_to(dst) for dst in table.known]
            outcomes.append((outcome, table.known, hops, table.search_robots(), table.advertised()))
    assert outcomes[0] == outcomes[1]


@property_test
@given(st.lists(st.lists(st.tuples(st.integers(0, 1079), st.integers(0, 1)), max_size=30), max_size=4))
def test_cells_from_elsewhere_are_equal(kernels: ModuleType, chunks: list[list[tuple[int, int]]]) -> None:
    ours, theirs = OwnMap(robot_config()), OwnMap(robot_config())
    for chunk in chunks:
        cells, values = np.array([c for c, _ in chunk], np.uint32), np.array([v for _, v in chunk], np.int8)
        with using(None):
            theirs.apply(cells, values)
        with using(kernels):
            ours.apply(cells, values)
    np.testing.assert_array_equal(ours.cells, theirs.cells)
    assert ours.version == theirs.version
    np.testing.assert_array_equal(ours.changes(0)[0], theirs.changes(0)[0])


def test_cells_outside_are_refused_and_nothing_is_taken_over(kernels: ModuleType) -> None:
    for module in (None, kernels):
        own = OwnMap(robot_config())
        with using(module), pytest.raises(IndexError):
            own.apply(np.array([5, own.cells.size], np.uint32), np.array([0, 0], np.int8))
        assert own.cells[5] == UNKNOWN
        with using(module):
            assert own.geometry.holds(np.zeros(0, np.uint32))
            assert own.geometry.holds(np.array([0, own.cells.size - 1], np.uint32))
            assert not own.geometry.holds(np.array([0, own.cells.size, 3], np.uint32))


@property_test
@given(st.lists(anywhere, max_size=12))
def test_distances_are_equal(kernels: ModuleType, places: list[tuple[float, float]]) -> None:
    xy_m = np.array(places, np.float64).reshape(-1, 2)
    with using(None):
        expected = medium.propagation.distances_m(xy_m)
    with using(kernels):
        np.testing.assert_array_equal(medium.propagation.distances_m(xy_m), expected)


frames_heard = st.lists(st.tuples(st.integers(0, 33_000), st.floats(allow_infinity=False), st.binary(max_size=9)))


@property_test
@given(st.integers(0, 2**31 - 1), frames_heard, st.data())
def test_inboxes_are_equal(
    kernels: ModuleType, tick: int, heard: list[tuple[int, float, bytes]], data: st.DataObject
) -> None:
    inbox = Inbox(tick, tuple(heard))
    with using(None):
        packed = inbox.encode()
    with using(kernels):
        assert inbox.encode() == packed
    packed = packed[: data.draw(st.integers(len(packed) - 3, len(packed)))]
    outcomes: list[object] = []
    for module in (None, kernels):
        with using(module):
            try:
                outcomes.append(Inbox.decode(packed))
            except WireError as error:
                outcomes.append(str(error))
    assert outcomes[0] == outcomes[1]


half_steps = st.integers(-(10**8), 10**8).map(lambda n: n / 200_000)


@property_test
@given(st.lists(st.one_of(half_steps, st.floats(-21_474.83648, 21_474.83647)), min_size=4, max_size=4), st.booleans())
def test_what_a_robot_says_of_itself_is_equal(kernels: ModuleType, places: list[float], need: bool) -> None:
    said = []
    for module in (None, kernels):
        table = ForwardingTable(1)
        table.set_route(1, freshness_of(2, 0), 1)
        with using(module):
            table.set_inherent(1, 1, (places[0], places[1]), (places[2], places[3]), need=need)
            said.append(table.advertised())
    assert said[0] == said[1]


def test_a_run_has_the_same_trace(kernels: ModuleType) -> None:
    digests = []
    for module in (None, kernels):
        with using(module):
            run = Simulation(load("three_cells", {"robots": 5, "radius_m": 12.0, "duration_s": 60.0, "seed": 4})).run()
        digests.append(run.trace_sha256)
    assert digests[0] == digests[1]
