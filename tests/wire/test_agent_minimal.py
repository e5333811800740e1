"""`examples/agent_minimal.py`, a robot without any code of ours: it reads and writes the vectors, and routes."""

from __future__ import annotations

import ast
import sys
from typing import Any

import msgpack
import pytest

from agents.messages import one_hop_on
from bus.handover import plain
from bus.keys import WIRE_VERSION
from bus.mailbox import PART_BYTES, in_parts
from deploy.scenario import Scenario, load
from tests.helpers.foreign import AGENT, WithForeign, agent
from tests.wire.vectors import ALL
from world.terms import UNREACHABLE, Mode

BY_NAME = {message.name: message for message in ALL}


def vectors(name: str) -> list[tuple[bytes, dict[str, Any]]]:
    return [(bytes.fromhex(vector["bytes"]), vector["meaning"]) for vector in BY_NAME[name].kept()["vectors"]]


def test_it_imports_nothing_of_ours() -> None:
    nodes = list(ast.walk(ast.parse(AGENT.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    assert names - sys.stdlib_module_names == {"zenoh", "msgpack"}


def test_it_reads_the_vectors() -> None:
    it = agent()
    assert it.WIRE_VERSION == WIRE_VERSION
    for data, told in vectors("turn"):
        assert [part.hex() for part in it.open_turn(data)] == [told["sense"], told["inbox"]]
    for data, told in vectors("header"):
        kind, incarnation, message = it.open_header(data)
        assert (kind, incarnation, message.hex()) == (told["kind"], told["incarnation"], told["message"])
    for data, told in vectors("sense"):
        sense = it.read_sense(data)
        beams = it.NO_SCAN if told["ranges_m"] is None else len(told["ranges_m"])
        assert sense == {name: told[name] for name in sense if name != "beams"} | {"beams": beams}
    for data, told in vectors("inbox"):
        room, heard = it.read_inbox(data)
        assert room == told["room_bytes"]
        assert [[src, power, payload.hex()] for src, power, payload in heard] == told["receptions"]
    for data, told in vectors("row"):
        dst, freshness, inherent = it.ROW.unpack(data)
        assert (dst, freshness) == (told["dst"], told["freshness"])
        assert [v / 100_000 for v in it.INHERENT.unpack(inherent)[1:]] == told["at_m"] + told["target_m"]


def test_it_writes_the_vectors() -> None:
    it = agent()
    for data, told in vectors("row"):
        assert it.row(told["dst"], told["freshness"], data[-18:]) == data
        if told["cls"] == it.RELAY and not told["need"]:
            assert it.inherent_of(*told["at_m"], *told["target_m"]) == data[-18:]
    for data, told in vectors("transmission"):
        frames = [(dst, bytes.fromhex(payload)) for dst, payload in told["frames"]]
        answer = it.answer_of(7, told["tick"], told["src"], frames, b"motion")
        assert answer[13 : -len(b"motion")] == data
    for data, told in vectors("update"):
        rows, acks, ahead = (bytes.fromhex(told[name]) for name in ("rows", "acks", "ahead"))
        made = msgpack.unpackb(it.update_of(told["nms"], rows, acks, told["acks_version"], ahead))
        wanted = msgpack.unpackb(data)
        assert made == [*wanted[:2], -1, 0, *wanted[4:]], "it holds nobody back, and no map"
    (data, told), _ = vectors("motion")
    at = told["status"]["target_x_m"], told["status"]["target_y_m"]
    said = it.motion_of(told["tick"], (told["vx_m_s"], told["vy_m_s"]), -1, UNREACHABLE, Mode.WAIT, at)
    assert said == data[:20] + bytes([it.RELAY]) + data[21:]


def test_it_joins_parts_and_drops_a_message_that_lacks_one() -> None:
    it, parts = agent(), {}  # type: ignore[var-annotated]
    sent: list[tuple[bytes, bytes]] = []
    message = bytes(range(256)) * (2 * PART_BYTES // 256 + 1)
    in_parts(lambda data, attachment: sent.append((attachment, data)))(message)
    assert [it.joined(parts, "key", *part) for part in sent] == [None, None, message]
    assert [it.joined(parts, "key", *part) for part in (sent[0], sent[2])] == [None, None]
    assert parts == {}
    assert it.joined(parts, "key", None, b"short") == b"short"


def mission() -> Scenario:
    """Robots that start far apart; 4 is the example's, and its NMS is killed."""
    asked = {"robots": 6, "radius_m": 8.0, "seed": 2, "duration_s": 100.0, "station.start_radius_m": 16.0}
    return load("three_cells", asked | {"fault": ["kill:nms-of:4@60"]})


def test_it_routes_for_others_and_finds_another_nms() -> None:
    simulation = WithForeign(mission(), 4)
    result = simulation.run()
    (killed,) = result.finals["world"]["faults"]
    everybody = result.traces.nms.tolist()
    nms, hops = [row[3] for row in everybody], result.traces.hops[:, 3]
    assert nms[599] == int(killed["target"])
    assert hops[-1] < UNREACHABLE
    assert nms[-1] != nms[599]
    assert any(4 in row for row in everybody), "somebody's path leads through it"
    for tick, row in enumerate(everybody):
        for robot in range(1, 7):
            path = [robot]
            while (onward := row[path[-1] - 1]) > 0:
                assert onward not in path, f"a loop at tick {tick}: {row}"
                path.append(onward)
    for node, robot in simulation.robots.items():
        assert node == 4 or robot.bad_frames + robot.body.router.bad_frames == 0
    assert simulation.station is not None
    assert result.finals["station"]["merged"] > 0


def test_a_new_process_of_it_is_silent_until_its_old_routes_are_gone() -> None:
    simulation = WithForeign(load("three_cells", {"robots": 4, "radius_m": 20.0, "fault": ["restart:4@3+2"]}), 4)
    hops = []
    for _ in range(80):
        snapshot, _ = simulation.step()
        hops.append(int(snapshot.hops[3]))
    assert hops[29] == 1
    assert hops[50:61] == [UNREACHABLE] * 11
    assert hops[62] == 1


def test_it_walks_after_its_nms_when_the_link_grows_weak() -> None:
    it, config = agent(), mission().robot_config(4)
    robot = it.Relay(plain(config), 0, 0)

    def heard(tick: int, away_m: float) -> tuple[int, float, bytes]:
        """From robot 5, one hop from the MS, which is so far to the east."""
        rows = it.row(5, 2 * (tick - 1) * 256 + 255, it.inherent_of(20.0 + away_m, 30.0, 0.0, 0.0))
        rows += it.row(0, 2 * (tick - 2) * 256 + 254, robot.to_station)
        power_dbm = config.tx_power_dbm - config.loss_1m_db
        return 5, power_dbm - 10 * config.exponent * (away_m > 1), it.update_of(0, rows, b"", 0, b"")

    _, velocity, nms, hops, mode = robot.step(10, (20.0, 30.0), 10**6, [heard(10, 1.0)])
    assert (velocity, nms, hops, mode) == ((0.0, 0.0), 5, 2, Mode.WAIT)
    report, _ = vectors("scan_report")[0]
    child = 3, -60.0, report
    (update, carried), velocity, nms, hops, mode = robot.step(11, (20.0, 30.0), 10**6, [child, heard(11, 10.0)])
    assert carried == [5, one_hop_on(report)]
    assert velocity == (pytest.approx(config.rules.moving.trace_speed_m_s), 0.0)
    assert (nms, hops, mode) == (5, 2, Mode.INNER)
    told = {dst: freshness for dst, freshness, _ in it.ROW.iter_unpack(msgpack.unpackb(update[1])[4])}
    assert told == {4: 22 * 256 + 255, 5: 20 * 256 + 254, 0: 18 * 256 + 253}
    for tick in range(12, 22):
        frames, velocity, nms, hops, mode = robot.step(tick, (20.0, 30.0), 10**6, [child])
    assert len(frames) == 1, "without a route it carries nothing"
    assert (velocity, nms, hops, mode) == ((0.0, 0.0), -1, UNREACHABLE, Mode.LOST)
    assert robot.rows[0][0] == 19 * 256, "broken, and odd"
