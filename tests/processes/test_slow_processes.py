"""Slow, hung, dead: who is waited for and who is not, with real processes that think, wait, or stand still."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.emulation import Emulation
from deploy.run_folder.summary import shortfall
from deploy.scenario import load
from deploy.simulation import Simulation
from tests import ROOT
from tests.helpers.small_run import ODD_TICK, Endless, LockHolder, OddSpeaker, Thinker, Waiter, small_run
from tests.helpers.waiting import alive, wait_until

pytestmark = pytest.mark.processes

HANG_S = 2.0
FAR_SIGHTED = """
name = "far_sighted"
robots = 3
radius_m = 30.0
duration_s = 0.8

[floor_plan]
size_m = [80.0, 80.0]
resolution_m = 0.05
free = [[1, 1, 79, 79]]

[station]
position_m = [40.0, 40.0]

[lidar]
range_m = 25.0
"""
"""A floor of 1,600 by 1,600 cells, of which a scan shows 800,000: the first ticks take seconds."""


def test_robots_that_think_for_long_keep_their_places_and_the_digest(
    emulation: Callable[..., Emulation], tmp_path: Path
) -> None:
    file = tmp_path / "far_sighted.toml"
    file.write_text(FAR_SIGHTED)
    run = emulation(file, deadlines__hang_s=HANG_S)
    summary = run.summary
    assert (summary["status"], summary["faults"], summary["failures"]) == ("time_limit", [], [])
    assert summary["trace_sha256"] == Simulation(load(file)).run().trace_sha256


def test_a_robot_that_works_for_longer_than_the_deadline_of_a_silent_one_is_waited_for() -> None:
    with small_run(cores={2: Thinker}, hang_deadline_s=HANG_S) as run:
        run.until(lambda: run.tick > ODD_TICK, "the tick in which robot 2 thinks")
        assert all(snapshot.present.all() for snapshot in run.snapshots)
        run.interrupt()
        assert run.finals["world"]["faults"] == []


@pytest.mark.parametrize(
    ("core", "cause"),
    [(Endless, "thinks for more than 1.5 s"), (Waiter, "unresponsive"), (LockHolder, "unresponsive")],
)
def test_a_robot_that_never_answers_is_named_and_left_out(core: type[OddSpeaker], cause: str) -> None:
    with small_run(cores={2: core}, hang_deadline_s=HANG_S, think_deadline_s=1.5) as run:
        run.until(lambda: not run.present(2), "robot 2 departed")
        run.ticks(20)
        assert [run.present(node) for node in (1, 2, 3)] == [True, False, True]
        run.interrupt()
        told = [event.text for event in run.events if event.kind == "fault"]
        assert told == [f"robot 2: {cause}; its last tick did not count"]
        (fault,) = run.finals["world"]["faults"]
        assert (fault["target"], fault["at_s"]) == ("2", ODD_TICK / 10)


def test_a_run_without_robots_ends_at_once_and_says_so() -> None:
    with small_run(robots=2, cores={1: Endless}, hang_deadline_s=HANG_S, think_deadline_s=1.5) as run:
        run.signal("robot-2", signal.SIGKILL)
        run.until(lambda: "world" in run.finals, "the end")
        final = run.finals["world"]
        assert (final["status"], final["why"]) == ("no_robots", "no robot is left, and none is due back")
        assert final["ticks"] - ODD_TICK in (1, 2), "robot 2 may have answered the odd tick before it was killed"


@pytest.fixture(scope="module")
def out_of_robots(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, str, dict[str, Any]]]:
    """A run whose robots are killed at 2 and 3 s, in many processes and in one: status, errors and summary of each."""
    ended = []
    for engine in [], ["--in-process"]:
        out = tmp_path_factory.mktemp("run")
        command = [sys.executable, str(ROOT / "deploy" / "run_local.py"), "--robots", "2", "--quiet", "--no-recording"]
        command += ["--fault", "kill:1@2", "--fault", "kill:2@3", "--out", str(out), *engine]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        ended.append((done.returncode, done.stderr, json.loads((out / "summary.json").read_text())))
    return ended


def test_it_ends_in_one_process_as_in_many(out_of_robots: list[tuple[int, str, dict[str, Any]]]) -> None:
    (_, _, many), (_, _, one) = out_of_robots
    for key in ("status", "ticks", "trace_sha256", "why", "faults", "recoveries", "failures"):
        assert many[key] == one[key], key
    assert (many["status"], many["ticks"]) == ("no_robots", 31)


def test_its_exit_status_says_that_it_fell_short(out_of_robots: list[tuple[int, str, dict[str, Any]]]) -> None:
    for status, errors, summary in out_of_robots:
        assert status == 1
        assert errors == f"run_local.py: failed: {shortfall(summary)}\n"
        assert "at 3.1 s: no robot is left, and none is due back" in errors


def test_when_the_world_has_ended_the_launcher_ends(tmp_path: Path) -> None:
    """The medium is stopped for good, and with it the router: the world's last word reaches nobody."""
    script, out = str(ROOT / "deploy" / "run_local.py"), tmp_path / "run"
    command = [sys.executable, script, "--robots", "2", "--quiet", "--no-recording", "--out", str(out)]
    launcher = subprocess.Popen(
        [*command, "--set", "deadlines.medium_s=5"], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        wait_until(lambda: (out / "pids.json").exists() and "robot/2" in (out / "pids.json").read_text(), "a start")
        pids = json.loads((out / "pids.json").read_text())
        wait_until(lambda: (out / "metrics.csv").read_text().count("\n") > 5, "some simulated seconds")
        os.kill(pids["medium"], signal.SIGSTOP)
        _, errors = launcher.communicate()
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 1
    assert "failed" in errors
    assert not any(alive(pid) for pid in pids.values())
    assert json.loads((out / "summary.json").read_text())["status"] == "failed"
