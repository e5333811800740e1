"""External robots in a run: the launcher writes a file and starts nothing, and the run waits for whoever reads it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import ROOT
from tests.helpers.running import Running
from tests.helpers.waiting import wait_until

pytestmark = pytest.mark.processes

Start = Callable[..., Running]
AGENT = [sys.executable, "-m", "agents", "--credentials"]
"""A robot of ours, started by hand."""


def credentials(running: Running, robot: int) -> Path:
    """The file of an external robot, once it is there."""
    path = running.out / f"robot-{robot}.json"
    wait_until(lambda: path.exists() or running.process.poll() is not None, "the credentials file")
    assert path.exists(), running.ended()
    return path


def test_a_robot_of_ours_by_hand_makes_the_same_run(start: Start) -> None:
    of_all = ("--robots", 3, "--duration", 20, "--no-recording")
    running = start(*of_all, "--external", 3)
    path = credentials(running, 3)
    assert path.stat().st_mode & 0o777 == 0o600
    agent = subprocess.Popen([*AGENT, str(path)], cwd=ROOT, stderr=subprocess.PIPE, text=True)
    status, out, errors = running.ended()
    assert (status, errors) == (0, "")
    assert agent.communicate()[1].count("\n") == 1
    assert agent.returncode == 0
    assert f"robot 3 is external: start a process of it within 30 s that logs in with {path}" in out
    assert not path.exists()
    assert "robot/3" not in running.pids()
    one = start(*of_all, "--in-process")
    assert one.ended()[0] == 0
    for key in ("trace_sha256", "scan_reports", "ticks", "faults"):
        assert running.summary()[key] == one.summary()[key]
    assert running.summary()["external_robots"] == [3]
    assert one.summary()["external_robots"] == []


def test_no_command_stops_one(start: Start) -> None:
    running = start("--robots", 2, "--duration", 100_000, "--radius", 8, "--no-recording", "--external", 1)
    agent = subprocess.Popen([*AGENT, str(credentials(running, 1))], cwd=ROOT, stderr=subprocess.PIPE)
    running.wait_for(1)
    for words in (["kill", "1"], ["pause", "1", "5"], ["restart", "1", "5"]):
        asked = [sys.executable, str(ROOT / "deploy" / "ctl.py"), "--run", str(running.out), *words]
        told = subprocess.run(asked, capture_output=True, text=True, check=False)
        assert (told.returncode, told.stdout, told.stderr.count("\n")) == (1, "", 1)
        assert "robot 1: it is external, so that is up to whoever runs its process" in told.stderr
    agent.kill()
    agent.communicate()
    wait_until(lambda: (running.status() or {"robots": [1]})["robots"] == [2], "robot 1 departed")
    running.press_ctrl_c()
    assert running.ended()[0] == 0
    (fault,) = running.summary()["faults"]
    assert (fault["verb"], fault["target"]) == ("kill", "1")


def test_one_that_never_comes_is_named(start: Start) -> None:
    running = start("--robots", 2, "--duration", 5, "--external", 2, "--set", "deadlines.return_s=1", "--no-recording")
    path = credentials(running, 2)
    status, _, errors = running.ended()
    assert status == 1
    assert "robot 2" in errors
    assert "not there within 1 s" in running.summary()["why"]
    assert not path.exists()


def test_a_process_of_another_version_is_refused(start: Start) -> None:
    running = start(
        "--robots", 2, "--duration", 5, "--external", 2, "--set", "deadlines.return_s=300", "--no-recording"
    )
    path = credentials(running, 2)
    program = (
        "import sys, bus.keys; bus.keys.Token.__init__.__defaults__ = (7,);"
        "from agents.__main__ import main; main(sys.argv[1:])"
    )
    other = subprocess.run(
        [sys.executable, "-c", program, "--credentials", str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert other.returncode == 4, other.stderr
    assert "robot 2 speaks version 7 of the wire, not version 1" in other.stderr.splitlines()[-1]
    agent = subprocess.run([*AGENT, str(path)], cwd=ROOT, capture_output=True, check=False)
    assert agent.returncode == 0
    assert running.ended()[0] == 0
    events = [json.loads(line)["text"] for line in (running.out / "events.jsonl").read_text().splitlines()]
    assert [text for text in events if "was refused: robot 2 speaks version 7" in text]
