"""What a node says that it did must be possible, and victims count only if somebody placed them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from bus.codec import WireError
from medium.messages import Inbox
from tests.helpers.hand_driven import Run, config
from world.control import Control
from world.feed import Event, Snapshot
from world.limits import decode_word
from world.messages import Motion, Positions, Report, Sense, Status
from world.pace import Pace
from world.terms import STATION, Mode

ROBOTS = 4
TICK = 7
CELLS = 2


def word(node: int, said: Motion | Report) -> Motion | Report:
    return decode_word(node, TICK, said.encode(), robots=ROBOTS, cells=CELLS)


@pytest.mark.parametrize(
    "status",
    [
        Status(nms=ROBOTS + 1, hops=1),
        Status(msr=ROBOTS + 1),
        Status(nmsr=ROBOTS + 1),
        Status(nms=1, hops=ROBOTS + 1),
        Status(nms=1, hops=0),
        Status(nms=1),
        Status(hops=2),
        Status(reports_made=TICK + 2),
        Status(reports_made=TICK, reports_discarded=2),
        Status(reports_made=2**31 - 1),
        Status(reports_made=3, reports_buffered=4),
        Status(target_x_m=1e300),
        Status(newest_scan_tick=TICK + 1),
    ],
)
def test_a_motion_that_cannot_be_is_malformed(status: Status) -> None:
    with pytest.raises(WireError):
        word(1, Motion(TICK, 0.0, 0.0, status))
    best = Status(nms=ROBOTS, msr=ROBOTS, hops=ROBOTS, reports_made=TICK, reports_buffered=TICK, reports_discarded=1,
        newest_scan_tick=TICK,
    )  # fmt: skip
    assert word(1, Motion(TICK, 0.0, 0.0, best)) == Motion(TICK, 0.0, 0.0, best)


@pytest.mark.parametrize("rates", [(), (0.5,), (0.5, 0.5, 0.5), (0.5, 1.1), (0.5, float("nan"))])
def test_a_report_on_other_cells_is_malformed(rates: tuple[float, ...]) -> None:
    with pytest.raises(WireError):
        word(STATION, Report(TICK, False, rates, 0))
    assert word(STATION, Report(TICK, False, (0.5, 1.0), 0)) is not None


@pytest.mark.parametrize(
    ("node", "said"),
    [(1, Motion(TICK - 1, 0.0, 0.0, Status())), (STATION, Report(TICK + 1, False, (0.0,) * CELLS, 0))],
)
def test_what_is_said_of_another_tick_is_malformed(node: int, said: Motion | Report) -> None:
    with pytest.raises(WireError, match=f"of tick {said.tick} in an answer of tick {TICK}"):
        word(node, said)


@pytest.mark.parametrize("velocity", [(1e308, 1e308), (-1e308, 0.0), (1e308, 5e-324), (1e155, 1e155)])
def test_no_velocity_carries_a_robot_farther_than_it_can_go(velocity: tuple[float, float]) -> None:
    run = Run(config(ROBOTS))
    run.tick()
    before = run.world.begin().positions.xy_m
    run.world.end({node: Motion(1, *velocity, Status()) for node in range(1, ROBOTS + 1)}, None)
    after = run.world.begin().positions.xy_m
    assert np.hypot(*(after - before).T).max() <= 0.1 * config().top_speed_m_s * (1 + 1e-9)


def test_only_victims_that_were_placed_are_found() -> None:
    run = Run(config(ROBOTS, victims_m=np.zeros((2, 2))))
    end = run.tick(report=Report(0, False, (), 3, (0, 1, 2, 30_000)))
    assert end.snapshot.victims_found == (0, 1)
    assert [event.data for event in end.events if event.kind == "victim"] == [{"victim": 0}, {"victim": 1}]


def test_positions_are_of_different_nodes_on_this_earth() -> None:
    places = np.zeros((3, 2))
    for nodes, xy_m, loss in (
        ([0, 2, 2], places, 0.0),
        ([2, 1, 3], places, 0.0),
        ([-1, 1, 3], places, 0.0),
        ([0, 1, 2], places + 1e9, 0.0),
        ([0, 1, 2], places + np.nan, 0.0),
        ([0, 1, 2], places, 1.5),
    ):
        with pytest.raises(WireError):
            Positions.decode(Positions(0, np.array(nodes, np.int16), xy_m, (), loss).encode())


def test_a_scan_of_another_lidar_is_malformed() -> None:
    packed = Sense(0, True, 0, 1.0, 2.0, np.ones(180)).encode()
    assert Sense.decode(packed, 180).ranges_m is not None
    with pytest.raises(WireError):
        Sense.decode(packed, 181)


def test_nobody_hears_a_node_that_there_is_not() -> None:
    packed = Inbox(3, ((ROBOTS, -60.0, b"hello"),)).encode()
    assert Inbox.decode(packed, ROBOTS).receptions
    with pytest.raises(WireError):
        Inbox.decode(packed, ROBOTS - 1)


def snapshot(**columns: Any) -> Snapshot:
    n = 2
    ids, flags, places = np.arange(1, n + 1, dtype=np.int16), np.zeros(n, np.uint8), np.zeros((n, 2))
    good = {"nodes": ids, "present": flags, "xy_m": places, "cls": flags, "mode": flags, "hops": flags + 255}
    good |= {"nms": ids - 2, "msr": ids - 2, "target_m": places}
    return Snapshot(TICK, **good | columns)


@pytest.mark.parametrize(
    "columns",
    [
        {"nodes": np.array([1, 3], np.int16)},
        {"nodes": np.array([2, 1], np.int16)},
        {"present": np.array([0, 2], np.uint8)},
        {"cls": np.array([0, 2], np.uint8)},
        {"mode": np.array([max(Mode) + 1, 0], np.uint8)},
        {"nms": np.array([-2, 0], np.int16)},
        {"msr": np.array([0, 3], np.int16)},
        {"xy_m": np.full((2, 2), np.inf)},
        {"target_m": np.full((2, 2), 1e300)},
    ],
)
def test_a_snapshot_that_cannot_be_is_malformed(columns: dict[str, Any]) -> None:
    with pytest.raises(WireError):
        Snapshot.decode(snapshot(**columns).encode())
    assert Snapshot.decode(snapshot().encode()).tick == TICK


@pytest.mark.parametrize(
    "data", [{"a": b"bytes"}, {b"a": 1}, {"a": [float("nan")]}, {"a": {"b": [[[[[[[[[[[1]]]]]]]]]]]}}]
)
def test_facts_of_an_event_are_of_json_types(data: dict[Any, Any]) -> None:
    with pytest.raises(WireError):
        Event.decode(Event(TICK, "fault", 1, "words", data).encode())
    good = {"a": [1, 2.5, None, {"b": "c"}]}
    assert json.loads(json.dumps(Event.decode(Event(TICK, "fault", 1, "words", good).encode()).data)) == good


@pytest.mark.parametrize(
    "line",
    ["fault jam:0,1@1+1e308", "fault kill:4@1e300", "fault loss:" + "9" * 5000 + "@1+1", "step " + "9" * 5000,
     "fault jam:" + "1" * 5000 + ",2@1+1", "fault kill:" + "1" * 5000 + "@1", "x" * 10**6, "speed " + "1" * 10**6],
)  # fmt: skip
def test_whatever_an_operator_says_is_answered_in_few_words(line: str) -> None:
    control = Control(Pace(0.0, lambda: 0.0), ROBOTS, dict)
    assert 0 < len(json.loads(control.answer(line))["error"]) < 400
    assert control.take() == []
