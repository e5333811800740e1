"""Scans up and the map down, over lossy hops: nothing is lost silently (ARCHITECTURE, invariant 6)."""

from __future__ import annotations

import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config import Reporting, RobotConfig
from agents.evidence import SensorModel
from agents.map_downlink import MapCopy, MapDownlink
from agents.messages import MapChunk, ScanReport
from agents.neighbors import Neighbors
from agents.room import Room
from agents.scan_uplink import ScanUplink
from monitor_station.map_merger import MapMerger
from tests.helpers.routing_field import router_config
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

GEOMETRY = GridGeometry(20, 20)
CONFIG = RobotConfig(1, 1, GEOMETRY, (1.0, 1.0), (0.0, 0.0, 0.0, 0.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0)


def copy(chunk_cells: int) -> MapCopy:
    return MapCopy(chunk_cells, SensorModel(CONFIG))


def report(cells: list[int], value: int = FREE) -> ScanReport:
    return ScanReport(0, 0, 1, np.array(cells, np.uint32), np.full(len(cells), value, np.int8))


def boundless() -> Room:
    return Room(None, limited=False)


def make(uplink: ScanUplink, cells: list[int]) -> None:
    made = report(cells)
    uplink.make(0, made.cells, made.values, made.victims)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.3, 0.7]))
def test_every_report_is_merged_once_and_then_forgotten(seed: int, loss: float) -> None:
    rng = random.Random(seed)
    uplink, merger = ScanUplink(3, 1, Reporting()), MapMerger(CONFIG)
    acks: list[bytes] = [b""]
    for tick in range(600):
        if tick < 100 and rng.random() < 0.3:
            make(uplink, [rng.randrange(400) for _ in range(5)])
        for payload in uplink.due(tick, 2, boundless()):
            if rng.random() >= loss:
                merger.take(ScanReport.decode(payload))
        if rng.random() >= loss:
            acks.append(merger.acks())
        # An old acknowledgement may come late; it must not hurt.
        uplink.acknowledge(tick, rng.choice(acks[-3:]))
        assert uplink.buffered + merger.merged >= uplink.made
    assert merger.merged == uplink.made
    assert uplink.buffered == 0


def test_a_report_is_sent_again_after_twice_the_round_trip_and_not_before() -> None:
    uplink = ScanUplink(3, 0, Reporting())
    make(uplink, [1])
    sent = [tick for tick in range(60) if uplink.due(tick, 4, boundless())]
    assert sent == [0, 16, 32, 48]
    uplink = ScanUplink(3, 0, Reporting())
    make(uplink, [1])
    assert [tick for tick in range(25) if uplink.due(tick, 1, boundless())] == [0, 10, 20]


def test_acknowledgements_of_another_incarnation_do_not_count() -> None:
    old, new, merger = ScanUplink(3, 0, Reporting()), ScanUplink(3, 1, Reporting()), MapMerger(CONFIG)
    for uplink in (old, new):
        make(uplink, [1])
    for payload in old.due(0, 1, boundless()):
        merger.take(ScanReport.decode(payload))
    new.acknowledge(1, merger.acks())
    assert new.buffered == 1


def test_a_gap_is_not_acknowledged() -> None:
    uplink, merger = ScanUplink(3, 0, Reporting()), MapMerger(CONFIG)
    for k in range(3):
        make(uplink, [k])
    first, second, third = (ScanReport.decode(p) for p in uplink.due(0, 1, boundless()))
    merger.take(third)
    merger.take(first)
    uplink.acknowledge(1, merger.acks())
    assert uplink.buffered == 2
    merger.take(second)
    uplink.acknowledge(2, merger.acks())
    assert uplink.buffered == 0
    assert merger.take(second) is None


@given(st.permutations([report([1, 2], FREE), report([2, 3], OCCUPIED), report([2, 4], FREE)]))
def test_with_exact_sensors_occupied_beats_free_beats_unknown_in_any_order(reports: list[ScanReport]) -> None:
    merger = MapMerger(CONFIG)
    for k, one in enumerate(reports):
        merger.take(ScanReport(1, 0, k + 1, one.cells, one.values))
    assert merger.cells[:6].tolist() == [UNKNOWN, FREE, OCCUPIED, OCCUPIED, FREE, UNKNOWN]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.5]))
def test_a_child_gets_every_change_in_order_whatever_is_lost(seed: int, loss: float) -> None:
    rng = random.Random(seed)
    parent, child = MapDownlink(chunk_cells=7), copy(chunk_cells=7)
    neighbors = Neighbors(router_config(1))
    cells, values = np.array([], np.uint32), np.array([], np.int8)
    unseen = rng.sample(range(400), 400)
    for tick in range(4000):  # with half of all frames lost, 18 chunks sometimes take 400 ticks
        if tick >= 60 and child.version == parent.version:
            break
        if tick < 60:
            new = np.array([unseen.pop() for _ in range(rng.randrange(4))], np.uint32)
            parent.append(new, np.full(len(new), -1, np.int8))
        neighbors.hear(2, tick, -50.0)
        if rng.random() >= loss:
            neighbors.by_id[2].map_version = child.version
        for node, payload in parent.due(tick, [2], neighbors, boundless()):
            assert node == 2
            if rng.random() >= loss:
                more, what = child.receive(MapChunk.decode(payload))
                cells, values = np.concatenate((cells, more)), np.concatenate((values, what))
    assert child.version == parent.version == len(cells)
    reference = copy(chunk_cells=10_000)
    everything, _ = reference.receive(MapChunk(0, cells, values))
    assert everything.tolist() == cells.tolist()


def test_a_chunk_that_leaves_a_gap_brings_nothing() -> None:
    child = copy(chunk_cells=7)
    cells, _ = child.receive(MapChunk(3, np.array([1], np.uint32), np.array([-1], np.int8)))
    assert not cells.size
    assert child.version == 0


def test_a_child_that_answers_gets_each_change_once() -> None:
    parent, child = MapDownlink(chunk_cells=100), copy(chunk_cells=100)
    neighbors = Neighbors(router_config(1))
    parent.append(np.arange(10, dtype=np.uint32), np.full(10, -1, np.int8))
    sent, on_air = 0, []
    for tick in range(20):
        # Sent at a tick, heard and answered at the next, noticed at the one after.
        neighbors.hear(2, tick, -50.0).map_version = child.version
        for payload in on_air:
            child.receive(MapChunk.decode(payload))
        on_air = [payload for _, payload in parent.due(tick, [2], neighbors, boundless())]
        sent += len(on_air)
    assert (sent, child.version) == (1, 10)
