"""Faults at the first tick and before it: they are faults like any other, in one process and in many."""

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

from bus.nodes import node_name, user_name
from bus.session import Mailbox, Session
from deploy.emulation import Emulation
from deploy.scenario import load
from deploy.simulation import Simulation
from tests import ROOT
from tests.helpers.small_run import SmallRun, small_run

pytestmark = pytest.mark.processes

CORRIDOR = ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml"
FAULTS = [
    ["kill:station@0"],
    ["restart:station@0+1", "kill:3@0"],
    ["pause:station@0+1", "loss:0.3@0+1"],
    ["restart:2@0+0.1", "pause:3@0+1", "kill:4@0", "jam:0,1@0+1", "kill:1@0.1"],
]


@pytest.mark.parametrize("faults", FAULTS, ids=lambda faults: " ".join(faults))
def test_scheduled_faults_at_the_first_tick(emulation: Callable[..., Emulation], faults: list[str]) -> None:
    alone = Simulation(load(CORRIDOR, {"fault": faults, "duration_s": 4.0})).run()
    many = emulation(CORRIDOR, faults=faults, duration_s=4.0).summary
    assert (many["status"], many["failures"], many["wall_clock_faults"]) == ("time_limit", [], 0)
    assert many["trace_sha256"] == alone.trace_sha256
    assert many["faults"] == alone.finals["world"]["faults"]
    assert len(many["faults"]) == len(faults)


def replayed(run: Path, out: Path) -> dict[str, Any]:
    command = [sys.executable, str(ROOT / "deploy" / "run_local.py"), "--in-process", "--quiet", "--no-recording"]
    subprocess.run([*command, "--replay-faults", str(run), "--out", str(out)], check=True)
    return json.loads((out / "summary.json").read_text())  # type: ignore[no-any-return]


def test_robots_that_die_or_stand_still_before_they_show_themselves(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "tests.helpers.early_faults", str(tmp_path / "run")],
        capture_output=True, text=True, check=False, env=dict(os.environ, PYTHONPATH=str(ROOT)),
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["status"], summary["failures"]) == ("time_limit", [])
    faults = {fault["target"]: fault for fault in summary["faults"]}
    assert {target: (fault["verb"], fault["at_s"]) for target, fault in faults.items()} == {
        "2": ("kill", 0.0), "3": ("restart", 0.0),
    }  # fmt: skip
    assert faults["3"]["for_s"] > 1.0
    again = replayed(tmp_path / "run", tmp_path / "again")
    assert again["trace_sha256"] == summary["trace_sha256"]
    assert again["faults"] == summary["faults"]


def shown(run: SmallRun, node: int) -> None:
    """Wait until the world may know of the process of a node."""
    role, mailbox = "robot" if node else "station", Mailbox()
    with Session.connect(run.logins["operator"], watching=True) as session:
        session.watch(mailbox, session.keys.alive(role, node))
        run.until(lambda: mailbox.get(0.0) is not None, f"token of node {node}")


@pytest.mark.parametrize("node", [0, 2])
def test_a_process_that_dies_after_it_has_shown_itself(node: int) -> None:
    with small_run(absent=3) as run:
        shown(run, node)
        run.signal(user_name(node), signal.SIGKILL)
        run.processes[user_name(node)].join()
        run.start_robot(3)
        run.ticks(10)
        if node:
            run.start_robot(node, "again")
        else:
            run.start_station("again")
        back = f"{node_name(node)} is back"
        run.until(lambda: any(event.text.startswith(back) for event in run.events), "its return")
        run.interrupt()
        (fault,) = run.finals["world"]["faults"]
        assert (fault["verb"], fault["at_s"]) == ("restart", 0.0)
        assert all(snapshot.present[[0, 2]].all() for snapshot in run.snapshots)


def test_a_process_that_is_stopped_after_it_has_shown_itself() -> None:
    with small_run(absent=3, hang_deadline_s=2.0) as run:
        shown(run, 2)
        run.signal("robot-2", signal.SIGSTOP)
        run.start_robot(3)
        run.until(lambda: bool(run.snapshots), "the first tick")
        assert not run.snapshots[0].present[1]
        run.signal("robot-2", signal.SIGCONT)
        run.until(lambda: run.present(2), "robot 2 back")
        run.interrupt()
        (fault,) = run.finals["world"]["faults"]
        assert (fault["verb"], fault["at_s"]) == ("pause", 0.0)
