"""What robots do where bandwidth is limited: less at a time, what matters first, and nothing is lost."""

from __future__ import annotations

import random
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.announcer import Announcer
from agents.config import Reporting, RobotConfig
from agents.dsdv import Router
from agents.evidence import SensorModel
from agents.forwarding_table import ROW, freshness_of
from agents.map_downlink import MapCopy, MapDownlink
from agents.messages import ACK, AHEAD, MapChunk, ScanReport, Update
from agents.neighbors import Neighbors
from agents.room import Room
from agents.round_trip import RoundTrip
from agents.scan_uplink import ScanUplink
from bus.codec import WireError
from deploy.scenario import load
from deploy.simulation import Simulation
from medium.messages import BROADCAST, Inbox
from monitor_station.map_merger import MapMerger
from tests.helpers.routing_field import router_config
from world.grid import FREE, GridGeometry
from world.terms import NOBODY, STATION, Cls

CONFIG = RobotConfig(
    1, 1, GridGeometry(60, 60), (1.0, 1.0), (0.0, 0.0, 0.0, 0.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0
)  # fmt: skip


def room(left: int, share: int | None = None) -> Room:
    """What a radio takes that has `left` bytes, of `share` a tick."""
    return Room(Inbox(1, (), left, left if share is None else share), limited=True)


def scan(uplink: ScanUplink, cells: range, victims: tuple[tuple[int, float, float], ...] = (), tick: int = 0) -> None:
    uplink.make(tick, np.array(cells, np.uint32), np.full(len(cells), FREE, np.int8), victims)


def sent(uplink: ScanUplink, tick: int, left: int = 1000, hops: int = 1) -> list[int]:
    """Numbers of the reports that leave at a tick."""
    return [ScanReport.decode(payload).number for payload in uplink.due(tick, hops, room(left))]


# Scans up


def test_a_report_has_the_tick_of_its_scan_though_it_is_made_later() -> None:
    uplink = ScanUplink(3, 1, Reporting(window=2), limited=True)
    newest = []
    for tick in range(12):
        if tick in (2, 3):
            scan(uplink, range(60), tick=tick)
        sent(uplink, tick, left=150)
        newest.append((uplink.made, uplink.newest_scan_tick))
    # The second scan waits, as the third report, until the first one has left in two parts.
    assert newest[:4] == [(0, 0), (0, 0), (2, 2), (3, 3)]
    assert max(newest) == newest[-1]
    free = ScanUplink(3, 1, Reporting())
    for tick in (4, 9):
        scan(free, range(tick), tick=tick)
        assert free.newest_scan_tick == tick


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.3]), share=st.sampled_from([60, 300, 2000]))
def test_every_cell_arrives_through_whatever_there_is_room_for(seed: int, loss: float, share: int) -> None:
    rng = random.Random(seed)
    uplink, relay = (ScanUplink(node, 1, Reporting(), limited=True) for node in (3, 4))
    merger = MapMerger(CONFIG)
    acks: deque[tuple[bytes, bytes]] = deque([(b"", b"")], maxlen=3)
    seen: set[int] = set()
    victims: set[int] = set()
    left = {uplink: 0, relay: 0}
    tick = 0
    while tick < 100 or uplink.buffered:
        tick += 1
        assert tick < 20_000, "it never ends"
        if tick < 100 and rng.random() < 0.2:
            first, more = rng.randrange(3000), rng.randrange(600)
            scan(uplink, range(first, first + more), ((tick, 1.0, 2.0),))
            victims.add(tick)
            seen |= set(range(first, first + more))
        for node in left:
            left[node] = min(left[node] + share, 5 * share)
        for node in (uplink, relay):
            air = room(left[node], share)
            payloads = node.due(tick, 2, air)
            assert left[node] - air.left == sum(map(len, payloads))
            left[node] = air.left
            for payload in payloads:
                if rng.random() >= loss:
                    relay.carry(payload) if node is uplink else merger.take(ScanReport.decode(payload))
        if rng.random() >= loss:
            acks.append((merger.acks(), merger.ahead()))
        uplink.acknowledge(tick, *rng.choice(acks))
        assert uplink.made <= tick + 1, "what the world believes (world/limits.py)"
    assert set(np.flatnonzero(merger.cells == FREE).tolist()) == seen
    assert merger.tally()["ahead"] == {}
    assert set(merger.victims) == victims
    assert uplink.made == merger.merged


def test_a_scan_leaves_in_parts_of_half_a_share_one_in_a_tick_its_victims_first() -> None:
    uplink = ScanUplink(3, 0, Reporting(), limited=True)
    scan(uplink, range(500), ((1, 2.0, 3.0),))
    parts: list[ScanReport] = []
    for tick in range(1, 9):
        payloads = uplink.due(tick, 1, room(2000, 1000))
        assert all(len(payload) <= 500 for payload in payloads)
        assert len(payloads) <= 1
        parts += map(ScanReport.decode, payloads)
    assert [part.number for part in parts] == list(range(1, len(parts) + 1))
    assert np.concatenate([part.cells for part in parts]).tolist() == list(range(500))
    assert [part.victims for part in parts] == [((1, 2.0, 3.0),)] + [()] * (len(parts) - 1)


@given(st.integers(0, 300), st.integers(0, 4))
def test_a_report_is_no_longer_than_is_reckoned(cells: int, victims: int) -> None:
    report = ScanReport(999, 60_000, 2**31 - 1, np.arange(cells, dtype=np.uint32) + 2**31, np.zeros(cells, np.int8))
    report.victims = tuple((2**31 - 1, 1e7 / 3, 1e7 / 7) for _ in range(victims))
    most = ScanReport.HEAD_BYTES + cells * ScanReport.CELL_BYTES + victims * ScanReport.VICTIM_BYTES
    assert len(report.encode()) <= most
    chunk = MapChunk(2**31 - 1 - cells, report.cells, report.values)
    assert len(chunk.encode()) <= MapChunk.HEAD_BYTES + cells * MapChunk.CHANGE_BYTES


def test_what_waits_counts_as_buffered() -> None:
    uplink = ScanUplink(3, 0, Reporting(), limited=True)
    scan(uplink, range(300))
    assert (uplink.made, uplink.buffered) == (1, 1)
    assert sent(uplink, 1, left=100) == []
    assert (uplink.made, uplink.buffered) == (2, 2), "a part, and what is left of the scan"


def test_at_most_the_window_is_under_way() -> None:
    uplink = ScanUplink(3, 0, Reporting(window=3), limited=True)
    scan(uplink, range(3000))
    assert [number for tick in range(1, 8) for number in sent(uplink, tick)] == [1, 2, 3]
    uplink.acknowledge(8, ACK.pack(3, 0, 2))
    assert [number for tick in range(8, 11) for number in sent(uplink, tick)] == [4, 5]


def test_only_what_the_ms_lacks_is_sent_again() -> None:
    uplink = ScanUplink(3, 0, Reporting(), limited=True)
    for k in range(4):
        scan(uplink, range(k, k + 1))
    assert [sent(uplink, tick) for tick in range(1, 5)] == [[1], [2], [3], [4]]
    merger = MapMerger(CONFIG)
    for number in (1, 3, 4):
        merger.take(ScanReport(3, 0, number, np.array([number], np.uint32), np.zeros(1, np.int8)))
    assert merger.ahead() == AHEAD.pack(3, 0, 1, 0b11)
    uplink.acknowledge(5, merger.acks(), merger.ahead())
    assert uplink.buffered == 3
    again = [sent(uplink, tick) for tick in range(5, 30)]
    assert [numbers for numbers in again if numbers] == [[2]]
    merger.take(ScanReport(3, 0, 2, np.array([2], np.uint32), np.zeros(1, np.int8)))
    assert merger.ahead() == b""
    uplink.acknowledge(30, merger.acks(), merger.ahead())
    assert uplink.buffered == 0


def test_nobody_has_ahead_what_was_never_sent() -> None:
    uplink = ScanUplink(3, 0, Reporting(), limited=True)
    scan(uplink, range(1))
    assert sent(uplink, 1) == [1]
    with pytest.raises(WireError):
        uplink.acknowledge(2, ACK.pack(3, 0, 0), AHEAD.pack(3, 0, 0, 1))


def test_a_relay_keeps_in_order_what_does_not_fit_and_takes_no_copy_of_it() -> None:
    relay = ScanUplink(4, 0, Reporting(), limited=True)
    reports = [ScanReport(3, 0, k, np.arange(20, dtype=np.uint32), np.zeros(20, np.int8)).encode() for k in (1, 2, 3)]
    for payload in reports:
        relay.carry(payload)
    assert sent(relay, 1, left=len(reports[0]) + 10) == [1]
    for payload in reports:
        relay.carry(payload)  # their origin lost patience
    assert sent(relay, 2, left=10) == []
    assert sent(relay, 3) == [2, 3, 1]
    relay.carry(reports[0])
    relay.drop_carried()
    assert sent(relay, 4) == []


def test_patience_follows_the_measured_round_trip() -> None:
    """RFC 6298, 2.2 and 2.3."""
    clock = RoundTrip()
    assert clock.patience_ticks(10, 1) == 10.0
    clock.measure(20)
    assert clock.patience_ticks(10, 1) == 20.0 + 4.0 * 10.0
    clock.measure(28)
    smoothed, variation = 20.0 + (28.0 - 20.0) / 8.0, 0.75 * 10.0 + 0.25 * 8.0
    assert clock.patience_ticks(10, 1) == pytest.approx(smoothed + 4.0 * variation)
    assert clock.patience_ticks(10, 3) == pytest.approx(4.0 * (smoothed + 4.0 * variation))
    assert clock.patience_ticks(1000, 1) == 1000.0


def test_a_report_that_was_sent_twice_measures_nothing() -> None:
    uplink = ScanUplink(3, 0, Reporting(), limited=True)
    for k in range(3):
        scan(uplink, range(k, k + 1))
    assert [sent(uplink, tick) for tick in (1, 11, 12)] == [[1], [1, 2], [3]]
    uplink.acknowledge(13, ACK.pack(3, 0, 1))
    assert uplink._round_trip.patience_ticks(0, 1) == 0.0
    uplink.acknowledge(14, ACK.pack(3, 0, 2))
    assert uplink._round_trip.patience_ticks(0, 1) == 9.0


# Updates


def crowded_router(others: int) -> Router:
    """Of robot 1, which knows the MS and that many robots."""
    router = Router(router_config(1), random.Random(1), 0)
    router.table.set_route(STATION, freshness_of(2, 1), STATION)
    for dst in range(2, 2 + others):
        router.table.set_route(dst, freshness_of(2, 2), STATION)
    router.announce_self(1, (1.0, 1.0), Cls.SR, (1.0, 1.0))
    return router


def dsts(payload: bytes) -> list[int]:
    return [dst for dst, _, _ in ROW.iter_unpack(Update.decode(payload).rows)]


def test_an_update_has_the_own_row_and_that_of_the_ms_and_the_others_in_turn() -> None:
    announcer = Announcer(crowded_router(30))
    seen: list[int] = []
    for tick in range(12):
        air = room(400)
        payload = announcer.update(tick, STATION, NOBODY, 0, (b"", 0, b""), air)
        assert payload is not None
        assert len(payload) <= 200, "half of a share"
        assert air.left == 400 - len(payload)
        first, second, *others = dsts(payload)
        assert (first, second) == (1, STATION)
        seen += others
    assert seen[:30] == list(range(2, 32))
    assert seen[30:34] == [2, 3, 4, 5]


def test_with_little_room_updates_are_rarer_but_never_silent() -> None:
    router = crowded_router(30)
    announcer = Announcer(router)
    said = [tick for tick in range(1, 40) if announcer.update(tick, STATION, NOBODY, 0, (b"", 0, b""), room(100, 45))]
    gaps = set(np.diff(said).tolist())
    assert gaps == {4}, "less than the silence limit of 5 ticks"
    assert announcer.update(60, STATION, NOBODY, 0, (b"", 0, b""), room(50, 45)) is None, "there is no room"


def test_acknowledgements_come_after_routing_when_they_changed_and_again_after_a_second() -> None:
    announcer = Announcer(crowded_router(2))
    acks = b"".join(ACK.pack(robot, 0, 1) for robot in range(1, 10))

    def said(tick: int, what: bytes, left: int = 1000) -> bytes:
        payload = announcer.update(tick, STATION, NOBODY, 0, (what, 0, b""), room(left))
        assert payload is not None
        return Update.decode(payload).acks

    assert said(0, acks, left=150) == b"", "no room beside the rows"
    assert said(2, acks) == acks
    assert [tick for tick in range(3, 25) if said(tick, acks)] == [12, 22]
    more = ACK.pack(1, 0, 2) + acks[ACK.size :]
    assert said(25, more) == more


def test_an_update_without_acknowledgements_takes_none_back() -> None:
    listener, speaker = Router(router_config(2), random.Random(1), 0), crowded_router(0)
    rows = speaker.table.advertised()
    for tick, acks in ((3, ACK.pack(1, 0, 1)), (4, b"")):
        listener.step(tick, [(1, -60.0, Update(STATION, NOBODY, 0, rows, acks).encode())])
        assert listener.neighbors.by_id[1].acks == ACK.pack(1, 0, 1)


# The map down


def test_one_frame_serves_all_children_and_changes_arrive_in_whatever_there_is_room_for() -> None:
    parent = MapDownlink(2000)
    copies = {child: MapCopy(2000, SensorModel(CONFIG)) for child in (2, 3, 4)}
    neighbors = Neighbors(router_config(1))
    parent.append(np.arange(1000, dtype=np.uint32), np.full(1000, -1, np.int8))
    frames = 0
    for tick in range(100):
        for child, copy in copies.items():
            neighbors.hear(child, tick, -50.0).map_version = copy.version
        air = room(300)
        for dst, payload in parent.due(tick, [2, 3, 4], neighbors, air):
            assert dst == BROADCAST
            frames += 1
            for child, copy in copies.items():
                if tick >= 20 or child != 4:  # which comes late
                    copy.receive(MapChunk.decode(payload))
        assert air.left >= 0
    assert [copy.version for copy in copies.values()] == [1000] * 3
    each = -(-1000 // ((300 - MapChunk.HEAD_BYTES) // MapChunk.CHANGE_BYTES))
    assert frames < 3 * each


# Whole missions


@pytest.mark.parametrize(
    "radio",
    [{"bandwidth_bytes_s": 4000.0}, {"channel_bytes_s": 20_000.0}, {"bandwidth_bytes_s": 4000.0, "loss": 0.2}],
    ids=str,
)
def test_a_mission_with_a_limited_radio_delivers_what_it_sees(radio: dict[str, float]) -> None:
    overrides = {"robots": 4, "duration_s": 60.0, "seed": 5} | {f"radio.{key}": value for key, value in radio.items()}
    simulation = Simulation(load("three_cells", overrides))
    result = simulation.run()
    robots = simulation.robots.values()
    made, buffered = (sum(getattr(robot.uplink, what) for robot in robots) for what in ("made", "buffered"))
    assert result.finals["medium"]["frames"]["rejected"] == 0, "robots know what their radio takes"
    assert sum(robot.bad_frames + robot.body.router.bad_frames for robot in robots) == 0
    assert result.finals["station"]["bad_frames"] == 0
    assert result.finals["station"]["merged"] >= made - buffered
    assert made > 100
    assert buffered < 30
    free = Simulation(load("three_cells", overrides | dict.fromkeys(("radio.bandwidth_bytes_s",), 1e6)))
    free.run()
    assert simulation.station is not None
    assert free.station is not None
    known, possible = (np.count_nonzero(each.station.merger.cells >= 0) for each in (simulation, free))
    assert known > 0.9 * possible
