"""`examples/agent_minimal.py` as robot 4 of real runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from deploy.scenario import load
from tests.helpers.foreign import AGENT, WithForeign
from tests.helpers.waiting import wait_until
from tests.processes.test_external import Start, credentials

pytestmark = pytest.mark.processes

PATIENT = ("--set", "deadlines.hang_s=300", "--set", "deadlines.return_s=300")
"""It sends no beats, so a busy machine must not take it for hung."""


def agent(path: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-I", str(AGENT), str(path)], stderr=subprocess.PIPE, text=True)


def test_a_mission_in_which_another_robot_is_killed(start: Start) -> None:
    asked = {"robots": 4, "radius_m": 8.0, "duration_s": 30.0, "fault": ["kill:2@10"]}
    options = ("--robots", 4, "--radius", 8, "--duration", 30, "--fault", "kill:2@10", "--no-recording", *PATIENT)
    running = start(*options, "--external", 4)
    foreign = agent(credentials(running, 4))
    assert running.ended()[::2] == (0, "")
    assert (foreign.communicate()[1], foreign.returncode) == ("", 0)
    summary = running.summary()
    assert [(fault["verb"], fault["target"]) for fault in summary["faults"]] == [("kill", "2")]
    assert (summary["wall_clock_faults"], summary["scan_reports"]["lost"], summary["external_robots"]) == (0, 0, [4])
    assert summary["robots_at_end"][3]["hops"] >= 1
    assert summary["trace_sha256"] == WithForeign(load("three_cells", asked), 4).run().trace_sha256


def test_it_dies_and_comes_again_and_a_second_one_is_refused(start: Start) -> None:
    running = start("--robots", 4, "--radius", 8, "--duration", 100_000, "--no-recording", "--external", 4, *PATIENT)
    path = credentials(running, 4)
    first = agent(path)
    running.wait_for(1)
    second = agent(path)
    assert "refused: another living process is already robot 4" in second.communicate()[1]
    assert second.returncode == 4
    first.kill()
    first.communicate()
    wait_until(lambda: 4 not in (running.status() or {"robots": [4]})["robots"], "robot 4 departed")
    third = agent(path)
    wait_until(lambda: 4 in (running.status() or {"robots": []})["robots"], "robot 4 is back")
    running.press_ctrl_c()
    assert running.ended()[0] == 0
    assert third.communicate()[1] == ""
    assert third.returncode == 0
    (fault,) = running.summary()["faults"]
    assert (fault["verb"], fault["target"]) == ("restart", "4")
