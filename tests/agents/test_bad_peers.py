"""A peer's bad frame is data (ARCHITECTURE, invariant 5): whatever arrives, a robot and the station go on."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.forwarding_table import ROW, ForwardingTable, freshness_of
from agents.messages import MapChunk, ScanReport, Update
from agents.policies import policy_class
from agents.robot import Robot
from agents.vds import Vds
from bus.codec import pack
from deploy.scenario import load
from medium.messages import Inbox
from monitor_station.core import Station
from world.messages import Sense
from world.terms import NOBODY, STATION

LAST_TICK = 40


def update(rng: random.Random, tick: int, src: int) -> bytes:
    """A well-formed update that may say anything: far-off places, unheard-of robots, numbers of the future."""
    table = ForwardingTable(src)
    for dst in {STATION, src, rng.randrange(65_535), rng.randrange(1, 12)}:
        hop = 0 if dst == src else rng.choice([1, 2, 250, 254, 255])
        seqno = 2 * max(0, tick + rng.choice([-5, 0, 10**6])) + (hop == 255)
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


@pytest.mark.parametrize(
    ("freshness", "nms", "bad"),
    [
        pytest.param((2**56 - 1) * 256 + 200, NOBODY, 1, id="odd number, finite metric"),
        pytest.param(2**64 - 256, NOBODY, 1, id="a number that no clock reaches"),
        pytest.param(2**62 - 256, NOBODY, 0, id="highest number, infinite"),
        pytest.param(2**62 - 257, 2, 0, id="highest even number, which breaks to the highest"),
    ],
)
def test_whatever_a_neighbor_says_of_the_ms_the_table_stays_sound(freshness: int, nms: int, bad: int) -> None:
    robot = Robot(load("three_cells").robot_config(1), Vds, random.Random(1), 0, 0)
    rows = ROW.pack(2, freshness_of(0, 0), bytes(18)) + ROW.pack(STATION, freshness, bytes(18))
    heard = (2, -60.0, Update(STATION, NOBODY, 0, rows, b"").encode())
    for tick in range(LAST_TICK):
        robot.step(Sense(tick, tick == 0, 0, 28.0, 35.0), Inbox(tick, (heard,) if tick == 1 else ()) if tick else None)
        if tick == 1:
            assert (robot.body.router.ms.nms, robot.body.router.bad_frames) == (nms, bad)
    robot.body.router.table.check_invariants()


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
