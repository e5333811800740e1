"""A bad frame of a peer is data (ARCHITECTURE, invariant 5): robots and station go on after any frame."""

from __future__ import annotations

import dataclasses
import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.forwarding_table import ROW, ForwardingTable, freshness_of
from agents.messages import ACK, AHEAD, MapChunk, ScanReport, Update
from agents.policies import policy_class
from agents.predicted_links import PredictedLinks
from agents.robot import Robot
from bus.codec import pack
from deploy.scenario import load
from medium.messages import Inbox, Reception
from monitor_station.core import Station
from tests.oracles.forwarding_table import check_invariants
from world.grid import FREE, OCCUPIED
from world.messages import Sense
from world.terms import NOBODY, STATION

LAST_TICK = 40


def update(rng: random.Random, tick: int, src: int) -> bytes:
    """A well-formed update with arbitrary content: far places, unknown robots, numbers of the future."""
    table = ForwardingTable(src)
    for dst in {STATION, src, rng.randrange(1, 10), rng.choice([3, 11, 65_535])}:
        hop = 0 if dst == src else rng.choice([1, 2, 250, 254, 255])
        seqno = 2 * max(0, tick - rng.choice([1, 3, 5, -(10**6)])) + (hop == 255)
        table.set_route(dst, freshness_of(seqno, hop), src)
        places = [rng.choice([-2e4, -1.0, 0.0, 28.0, 2e4]) for _ in range(4)]
        table.set_inherent(
            dst, rng.randrange(2), (places[0], places[1]), (places[2], places[3]), need=rng.random() < 0.5
        )
    nms = rng.choice([NOBODY, STATION, 1, src])
    return Update(nms, rng.choice([NOBODY, 1]), rng.randrange(100), table.advertised(), b"\0" * 8).encode()


def payload(rng: random.Random, tick: int, src: int) -> bytes:
    kind = rng.randrange(6)
    cells = np.array(
        [rng.randrange(2**32) if rng.random() < 0.1 else rng.randrange(15_000) for _ in range(9)], np.uint32
    )
    values = np.array([rng.randrange(2) for _ in cells], np.int8)
    if kind == 0:
        return rng.randbytes(rng.randrange(40))
    if kind == 1:
        return MapChunk(rng.randrange(20), cells, values).encode()
    if kind == 2:
        return ScanReport(src, 0, rng.randrange(1, 9), cells, values).encode()
    if kind == 3:
        return pack((rng.randrange(5), -1, -1, 0, rng.randbytes(ROW.size), b""))
    return update(rng, tick, src)


@pytest.mark.parametrize("policy", ["vds", "scout"])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_nothing_that_is_heard_stops_a_robot(policy: str, seed: int) -> None:
    rng = random.Random(seed)
    scenario = load("three_cells", {"policy": policy, "radio.model": "disk_los"})
    robot = Robot(scenario.robot_config(1), policy_class(policy), random.Random(seed), 0, 0)
    ranges = np.full(180, 5.0)
    for tick in range(LAST_TICK):
        heard = [(src, -60.0, payload(rng, tick, src)) for src in sorted(rng.sample(range(8), 3))]
        sense = Sense(tick, tick == 0, 0, 29.0, 36.0, ranges if tick % 5 == 0 else None)
        frames, motion = robot.step(sense, Inbox(tick, tuple(heard)) if tick else None)
        assert frames
        assert np.hypot(motion.vx_m_s, motion.vy_m_s) < 1.0
    assert robot.bad_frames + robot.body.router.bad_frames > 0


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_nothing_that_is_heard_stops_the_station(seed: int) -> None:
    rng = random.Random(seed)
    station = Station(load("three_cells").station_config(), random.Random(1), 0, 0)
    for tick in range(LAST_TICK):
        heard = [(src, -60.0, payload(rng, tick, src)) for src in sorted(rng.sample(range(1, 8), 3))]
        frames, report = station.step(
            Sense(tick, tick == 0, 0, 28.0, 35.0), Inbox(tick, tuple(heard)) if tick else None
        )
        assert frames
        assert report.merged >= 0
        station.view()
    assert station.final()["bad_frames"] > 0


N = 9
"""Robots of three_cells."""


def rows(*entries: tuple[int, int, int]) -> bytes:
    """A forwarding table of (dst, sequence number, hop count)."""
    return b"".join(ROW.pack(dst, freshness_of(seqno, hop), bytes(18)) for dst, seqno, hop in entries)


def said(src: int, tick: int, *entries: tuple[int, int, int], **fields: Any) -> Reception:
    """An update of `src`, which is heard at `tick`: its own row, as it must be, and further ones."""
    own = (src, 2 * (tick - 1), 0)
    update = {"nms": NOBODY, "hold": NOBODY, "map_version": 0, "rows": rows(own, *entries), "acks": b""} | fields
    return src, -60.0, Update(**update).encode()


class Listener:
    """Robot 1, which hears given frames tick by tick."""

    def __init__(self, policy: str = "vds", **overrides: Any) -> None:
        config = load("three_cells", {"policy": policy} | overrides).robot_config(1)
        self.robot = Robot(config, policy_class(policy), random.Random(1), 0, 0)
        self.tick = 0
        self.heard: list[Reception] = []

    def step(self, *heard: Reception) -> None:
        ranges = np.full(180, 5.0) if self.tick % 5 == 0 else None
        sense = Sense(self.tick, self.tick == 0, 0, 28.0, 35.0, ranges)
        self.robot.step(sense, Inbox(self.tick, heard) if self.tick else None)
        check_invariants(self.robot.body.router.table)
        self.tick += 1

    def until(self, tick: int) -> None:
        while self.tick < tick:
            self.step()

    @property
    def bad(self) -> int:
        return self.robot.bad_frames + self.robot.body.router.bad_frames


@pytest.mark.parametrize(
    ("entry", "bad"),
    [
        pytest.param((STATION, 36, 1), 0, id="MS one hop away, as early as can be"),
        pytest.param((STATION, 38, 1), 1, id="MS one hop away, a tick too early"),
        pytest.param((STATION, 30, 4), 0, id="MS four hops away"),
        pytest.param((STATION, 32, 4), 1, id="MS four hops away, faster than a hop a tick"),
        pytest.param((STATION, 39, 255), 0, id="MS lost, as late as can be"),
        pytest.param((STATION, 41, 255), 1, id="MS lost, in the future"),
        pytest.param((STATION, 2**54, 1), 1, id="MS near 2^54"),
        pytest.param((STATION, 2**54 + 1, 255), 1, id="MS lost near 2^54"),
        pytest.param((STATION, 2**55 + 2, 1), 1, id="MS beyond any clock"),
        pytest.param((STATION, 36, 0), 1, id="it says that it is the MS"),
        pytest.param((STATION, 35, 1), 1, id="odd number, finite metric"),
        pytest.param((3, 36, 1), 0, id="a robot one hop away"),
        pytest.param((3, 38, 1), 1, id="a robot one hop away, a tick too early"),
        pytest.param((3, 2**54, 1), 1, id="a robot near 2^54"),
        pytest.param((3, 36, 0), 1, id="it says that it is another robot"),
        pytest.param((1, 2**54, 1), 1, id="me near 2^54"),
        pytest.param((N, 30, 1), 0, id="the last robot"),
        pytest.param((N + 1, 30, 1), 1, id="a robot that there is not"),
        pytest.param((30_000, 30, 1), 1, id="a far higher id"),
    ],
)
def test_a_row_that_cannot_be_is_malformed(entry: tuple[int, int, int], bad: int) -> None:
    listener = Listener()
    listener.until(20)
    listener.step(said(2, 20, entry))
    assert listener.bad == bad
    table = listener.robot.body.router.table
    dst, _, hop = entry
    if dst == STATION:
        assert table.next_hop_to(STATION) == (2 if not bad and hop < 255 else NOBODY)
    elif dst != 1:
        assert table.hop(dst) == (255 if bad else hop + 1)
    assert max(table.known) <= N
    # A later update is accepted as if there had been none.
    listener.step(said(2, 21, (STATION, 38, 1), (3, 38, 1)))
    assert (table.hop(STATION), table.hop(3)) == (2, 2)


@pytest.mark.parametrize(
    "fields",
    [
        {"nms": N + 1},
        {"hold": N + 1},
        {"map_version": -1},
        {"acks_version": -1},
        {"acks": ACK.pack(N + 1, 0, 1)},
        {"acks": ACK.pack(STATION, 0, 1)},
        {"acks": ACK.pack(4, 0, 21)},
        {"acks": ACK.pack(4, 19, 2)},
        {"acks": ACK.pack(4, 0, 2**32 - 1)},
        {"acks": ACK.pack(4, 0, 1) * 2},
        {"acks": ACK.pack(4, 0, 1) + ACK.pack(3, 0, 1)},
        {"ahead": AHEAD.pack(4, 0, 1, 1)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(4, 0, 1, 0)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(N + 1, 0, 1, 1)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(STATION, 0, 1, 1)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(4, 0, 1, 1 << 18)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(4, 18, 1, 1)},
        {"acks": ACK.pack(4, 0, 1), "ahead": AHEAD.pack(4, 0, 1, 1) * 2},
    ],
)
def test_an_update_that_cannot_be_is_malformed(fields: dict[str, Any]) -> None:
    listener = Listener()
    listener.until(20)
    listener.step(said(2, 20, **fields))
    assert (listener.bad, list(listener.robot.body.router.neighbors.by_id)) == (1, [])
    acks, ahead = ACK.pack(3, 1, 20) + ACK.pack(4, 0, 21), AHEAD.pack(3, 1, 16, 0b100)
    listener.step(said(2, 21, nms=N, hold=N, acks=acks, ahead=ahead))
    assert (listener.bad, list(listener.robot.body.router.neighbors.by_id)) == (1, [2])


def chunk(first: int, cells: Any, values: Any) -> Reception:
    return 2, -60.0, MapChunk(first, np.array(cells, np.uint32), np.array(values, np.int8)).encode()


@pytest.mark.parametrize("policy", ["vds", "scout"])
def test_a_robot_whose_whole_map_is_said_to_be_wall_goes_on(policy: str) -> None:
    listener = Listener(policy)
    listener.until(6)
    known = np.flatnonzero(listener.robot.body.map.cells >= 0)
    for start in range(0, len(known), 2000):
        cells = known[start : start + 2000]
        listener.step(chunk(start, cells, np.ones(len(cells))))
    assert not (listener.robot.body.map.cells == FREE).any()
    # With a route and without one, as a relay and as a search robot.
    for tick in range(listener.tick, listener.tick + 40):
        entries = (STATION, 2 * (tick - 2), 1), (3, 2 * (tick - 2), 1), (4, 2 * (tick - 2), 1)
        listener.step(said(2, tick, *entries), said(5, tick, nms=1))
    listener.until(listener.tick + 40)
    assert listener.bad == 0


def test_changes_that_the_ms_cannot_have_made_are_malformed() -> None:
    listener = Listener("vds")
    size = listener.robot.body.map.geometry.size
    cells = [5, 1, 2]
    bad = [
        chunk(0, np.arange(2001), np.zeros(2001)),  # more than is sent at once
        chunk(0, [size], [1]),  # no cell
        chunk(0, [5], [0]),  # changes nothing
        chunk(0, [5, 5], [-1, -1]),
        chunk(0, [5], [2]),  # more than odds can be
        chunk(0, [5], [-2]),
    ]
    listener.until(6)
    for reception in bad:
        listener.step(reception)
    assert (listener.bad, listener.robot.downlink.version) == (len(bad), 0)
    listener.step(chunk(0, cells, [-1, -1, 1]))
    listener.step(chunk(2, [2, 1], [1, 1]))  # what is known, and a cell that turned out to be a wall
    listener.step(chunk(4, cells[:1], [-1]))  # again
    assert (listener.bad, listener.robot.downlink.version) == (len(bad) + 1, 4)
    assert listener.robot.body.map.cells[cells].tolist() == [0, 1, 1]


def test_an_acknowledgement_of_what_was_never_sent_is_malformed() -> None:
    """Or the report would be dropped without being sent."""
    listener = Listener()
    listener.until(7)
    uplink = listener.robot.uplink
    assert (uplink.made, uplink.buffered) == (1, 1), "without a route nothing is sent"
    listener.step(said(2, 7, (STATION, 10, 1), acks=ACK.pack(1, 0, 1)))
    assert (uplink.buffered, listener.bad) == (1, 1)
    listener.step(said(2, 8, (STATION, 12, 1), acks=ACK.pack(1, 0, 2)))
    assert (uplink.buffered, listener.bad) == (1, 2)
    listener.step(said(2, 9, (STATION, 14, 1), acks=ACK.pack(1, 0, 1)))
    assert (uplink.buffered, listener.bad) == (0, 2)


@pytest.mark.parametrize("wall_factor", [1e20, math.inf])
def test_walls_without_number_and_powers_without_measure_make_a_node_very_far_away(wall_factor: float) -> None:
    robot = Listener("scout").robot
    body = robot.body
    body.config = dataclasses.replace(body.config, wall_factor=wall_factor)
    stripes = body.map.cells.reshape(body.map.geometry.rows, -1)
    stripes[:, ::2], stripes[:, 1::2] = OCCUPIED, FREE  # two dozen walls up to node 2
    body.router.table.set_inherent(2, 0, (52.0, 35.0), (0.0, 0.0))
    assert PredictedLinks(body, predict=True).predicted_m((28.0, 35.0), 2) > 1e100
    assert body.router.neighbors.hear(3, 1, -1e308).distance_m > 1e100


def test_what_a_robot_says_of_far_away_places_fits_its_row() -> None:
    table = ForwardingTable(1)
    table.set_inherent(1, 0, (-1e8, 1e8), (3.0, 4.0))
    assert (table.location_m(1), table.target_m(1)) == ((-21474.83647, 21474.83647), (3.0, 4.0))
