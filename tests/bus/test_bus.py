"""Barrier, patience, headers, seats, pace and credentials files: what needs no socket."""

from __future__ import annotations

import json
import math
import os
import random
from pathlib import Path

import numpy as np
import pytest

from agents.__main__ import main as agents_main
from agents.config import RobotConfig
from bus.access import credentials
from bus.codec import WireError
from bus.handover import build, plain, read, write
from bus.lockstep import Gather, Kind, Patience, batch, seal, unbatch, unseal
from world.attendance import Attendance
from world.config import Fault, WorldConfig
from world.grid import GridGeometry
from world.pace import Pace
from world.stopwatch import Stopwatch


def test_barrier_is_the_same_for_every_order_of_arrival() -> None:
    nodes = list(range(6))
    for seed in range(20):
        random.Random(seed).shuffle(nodes)
        gather: Gather[str] = Gather(7, range(6))
        for node in nodes[:5]:
            assert gather.add(node, f"m{node}")
            assert not gather.add(node, "again")
        assert gather.missing == {nodes[5]}
        gather.depart(nodes[5])
        assert not gather.missing
        assert not gather.add(nodes[5], "too late")
        assert list(gather.messages) == sorted(nodes[:5])
        assert gather.last == nodes[4]


def test_message_of_a_departed_node_stays_if_it_came_before() -> None:
    gather: Gather[str] = Gather(0, [1, 2])
    gather.add(1, "said")
    gather.depart(1)
    gather.depart(2)
    assert gather.messages == {1: "said"}
    assert 2 in gather
    assert 3 not in gather
    assert not gather.add(3, "not in the roster")


def test_suspended_host_costs_one_slice() -> None:
    patience = Patience(100.0)
    assert patience.wait(100.05) == pytest.approx(0.05)
    assert patience.wait(4000.0) == pytest.approx(0.05 + Patience.SLICE_S)
    assert patience.wait(3999.0) == pytest.approx(0.05 + Patience.SLICE_S)
    for i in range(19):
        patience.wait(3999.0 + 0.1 * (i + 1))
    assert patience.waited_s == pytest.approx(2.05)


def test_headers_and_batches_come_back() -> None:
    assert unseal(seal(Kind.STOP, 0xFFFF_FFFF, b"body")) == (Kind.STOP, 0xFFFF_FFFF, b"body")
    assert unbatch(batch([b"a", b""])) == [b"a", b""]


@pytest.mark.parametrize("data", [b"", b"\x00\x00", b"\xff\x00\x00\x00\x00", b"\x09\x00\x00\x00\x00body"])
def test_bad_header_is_a_wire_error(data: bytes) -> None:
    with pytest.raises(WireError):
        unseal(data)


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x01", b"\x91\x01", b"\x91" * 2000])
def test_bad_batch_is_a_wire_error(data: bytes) -> None:
    with pytest.raises(WireError):
        unbatch(data)


def test_first_process_arrives_and_a_second_is_refused() -> None:
    seats = Attendance()
    assert seats.came(4, 11)
    assert seats.arrivals() == [(4, True)]
    assert seats.arrivals() == []
    assert not seats.came(4, 12)
    assert seats.token(4) == 11
    assert not seats.left(4, 12)
    assert seats.left(4, 11)
    assert seats.token(4) == 0
    assert seats.came(4, 13)


def test_who_is_refused_is_told_once_and_made_up_tokens_are_soon_told_nothing() -> None:
    seats = Attendance()
    told = [bool(seats.refuse(4, token, "")) for token in (*range(100), *range(100))]
    assert told == [True] * 16 + [False] * 184
    assert seats.refuse(5, 1, ""), "another node's processes are told as ever"


def test_silent_process_thaws_once_or_is_replaced() -> None:
    seats = Attendance()
    seats.came(4, 11)
    seats.arrivals()
    seats.heard(4, 11)
    assert seats.arrivals() == []
    seats.silent(4)
    seats.heard(4, 11)
    seats.heard(4, 11)
    assert seats.arrivals() == [(4, False)]
    seats.silent(4)
    assert seats.came(4, 12)
    assert seats.arrivals() == [(4, True)]
    assert not seats.seated(4, 11)


def test_process_that_goes_before_it_was_admitted_never_arrived() -> None:
    seats = Attendance()
    seats.came(4, 11)
    assert not seats.left(4, 11)
    assert seats.arrivals() == []


def test_scheduled_kill_gives_up_the_seat_before_the_token_drops() -> None:
    seats = Attendance()
    seats.came(4, 11)
    seats.arrivals()
    seats.signalled(4, "kill")
    seats.signalled(4, "spawn")
    assert seats.came(4, 12)
    assert not seats.left(4, 11)
    assert seats.arrivals() == [(4, True)]


def test_scheduled_pause_keeps_the_seat() -> None:
    seats = Attendance()
    seats.came(4, 11)
    seats.arrivals()
    seats.signalled(4, "stop")
    assert not seats.came(4, 12)
    seats.heard(4, 11)
    assert seats.arrivals() == []
    seats.signalled(4, "cont")
    assert seats.token(4) == 11


class Clock:
    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


def test_pace_follows_speed_hold_and_step() -> None:
    clock = Clock()
    pace = Pace(2.0, clock)
    assert pace.delay_s(10) == 0.0
    assert pace.delay_s(30) == pytest.approx(1.0)
    clock.now_s += 100.0
    assert pace.delay_s(30) == 0.0
    assert json.loads(pace.command("hold", dict))["held"]
    assert pace.delay_s(30) == math.inf
    pace.command("step 2", dict)
    for tick in (30, 31):
        assert pace.delay_s(tick) == 0.0
        pace.began()
    assert pace.delay_s(32) == math.inf
    answer = json.loads(pace.command("speed 10", lambda: {"tick": 32}))
    assert answer == {"tick": 32, "held": False, "speed": 10.0, "interrupted": False}
    # The schedule starts anew: nothing is made up for.
    assert pace.delay_s(32) == 0.0
    assert pace.delay_s(42) == pytest.approx(0.1)
    pace.command("hold", dict)
    pace.command("interrupt", dict)
    assert pace.delay_s(42) == 0.0
    assert pace.interrupted


def test_pace_that_begins_held_goes_on_when_told() -> None:
    pace = Pace(0.0, Clock(), held=True)
    assert pace.delay_s(0) == math.inf
    assert not json.loads(pace.command("go", dict))["held"]
    assert pace.delay_s(0) == 0.0


@pytest.mark.parametrize(
    "line",
    [
        "",
        "speed",
        "speed 0",
        "speed -1",
        "speed nan",
        "speed inf",
        "step 0",
        "step x",
        "go on",
    ],
)
def test_bad_command_changes_nothing_and_says_why(line: str) -> None:
    pace = Pace(0.0, Clock())
    assert "error" in json.loads(pace.command(line, dict))
    assert pace.delay_s(10**6) == 0.0


def test_blame_is_shared_out() -> None:
    watch = Stopwatch(iter((100.0, 104.0)).__next__)
    watch.tick(0.0, 1.0, 4.0, 6.0, 7.0, "robot-1")
    watch.tick(10.0, 10.0, 11.0, 11.0, 11.0, "station")
    final = watch.final()
    assert final["tick_blame"] == {"medium": 0.25, "robot-1": 0.375, "station": 0.125, "world": 0.25}
    assert final["tick_ms"]["p50"] == pytest.approx(4000.0)
    assert final["ticked_unix_s"] == [93.0, 104.0], "the first tick began seven seconds before it was counted"
    assert Stopwatch(lambda: 0.0).final()["tick_ms"]["p50"] is None


def _robot_config() -> RobotConfig:
    geometry = GridGeometry(4, 5, 0.5, -1.0, 2.0)
    return RobotConfig(3, 1, geometry, (1.0, 2.0), (0.0, 0.0, 1.0, 1.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0)


def test_configuration_survives_a_file(tmp_path: Path) -> None:
    login = credentials("run", "tcp/127.0.0.1:7447", 3)["robot-3"]
    path = tmp_path / "credentials"
    write(path, login, config=_robot_config(), users=None)
    assert path.stat().st_mode & 0o077 == 0
    handover = read(path, connect="tcp/10.0.0.1:1")
    assert handover.login.password == login.password
    assert handover.login.endpoint == "tcp/10.0.0.1:1"
    assert build(RobotConfig, handover.entries["config"]) == _robot_config()


def test_credentials_in_a_pipe_or_a_folder_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, what in (
        (tmp_path / "pipe", "a pipe or a device"),
        (tmp_path, "a folder"),
        (tmp_path / "x", "No such file"),
    ):
        with pytest.raises(ValueError, match=f"is no credentials file: .*{what}"):
            read(path)


def test_arrays_and_faults_survive_json() -> None:
    occupied = np.zeros((4, 5), np.bool_)
    occupied[1, 2] = True
    starts = np.array([(1.0, 2.0), (3.0, 4.0)])
    faults = (Fault("kill", 1.0, "4"), Fault("pause", 2.0, "station", 3.0))
    config = WorldConfig(1, 2, GridGeometry(4, 5), occupied, (1.0, 2.0), starts, 0.5, 10.0, faults=faults)
    again: WorldConfig = build(WorldConfig, json.loads(json.dumps(plain(config))))
    assert (again.occupied == occupied).all()
    assert again.occupied.dtype == np.bool_
    assert (again.starts_m == starts).all()
    assert again.victims_m.shape == (0, 2)
    assert again.faults == faults
    assert again.lidar == config.lidar


def test_bad_credentials_file_is_one_line_and_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "credentials"
    login = credentials("run", "tcp/127.0.0.1:7447", 3)["robot-3"]
    deep, long = "[" * 10**5, json.dumps({"login": plain(login), "config": {"node": "x" * 10**5, "y" * 10**5: 1}})
    wrong = [
        json.dumps({"login": plain(login) | {"endpoint": 7}}),
        json.dumps({"login": plain(login) | {"user": "u" * 20_000}, "config": plain(_robot_config())}),
        json.dumps({"login": plain(login) | {"run": "a/b\n" * 10_000}}),
        json.dumps({"login": plain(login), "config": plain(_robot_config()) | {"robots": "x"}}),
    ]
    for content in (
        None,
        "",
        "{}",
        json.dumps({"login": plain(login)}),
        "[]",
        '{"login": []}',
        deep,
        long,
        "9" * 5000,
        *wrong,
    ):
        if content is not None:
            path.write_text(content)
        with pytest.raises(SystemExit) as ended:
            agents_main(["--credentials", str(path)])
        assert ended.value.code == 2
        words = capsys.readouterr().err
        assert words.count("\n") == 1
        assert len(words) < 600
    write(path, login, config=_robot_config())
    with pytest.raises(SystemExit) as ended:
        agents_main(["--credentials", str(path), "--id", "2"])
    assert ended.value.code == 2
    assert "not robot 2's" in capsys.readouterr().err
