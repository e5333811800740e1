"""Links that don't move, and senders who don't stop: nobody holds a run up from whom nothing is awaited."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from bus.session import Session, new_token
from tests.helpers.rogue import ANSWERS, FLOOD, beat_flood, flood, impostor, stopped_listener
from tests.helpers.small_run import SmallRun, small_run

pytestmark = pytest.mark.processes

FULL = 1500
"""Ticks after which the link to a process that does not read is full several times over."""
MOST_GROWTH_KB = 250_000


def told(run: SmallRun) -> list[str]:
    return [event.text for event in run.events if event.kind == "fault"]


def test_a_frozen_process_does_not_stop_the_turns_of_its_successor() -> None:
    with small_run(hang_deadline_s=2.0) as run:
        run.signal("robot-1", signal.SIGSTOP)
        run.until(lambda: not run.present(1), "robot 1 departed")
        run.start_robot(1, "successor")
        run.until(lambda: run.present(1), "its successor takes part")
        run.ticks(FULL)
        assert run.present(1)
        run.interrupt()
        assert "took nothing" not in run.log("medium"), "what is meant for the successor goes to it alone"
        assert len(run.finals["world"]["faults"]) == 1


def test_a_second_subscriber_that_stands_still_is_cut_off() -> None:
    with small_run() as run:
        run.start_rogue(stopped_listener, 2)
        run.until(lambda: "a process that listens for robot 2 took nothing: its link was cut" in told(run), "the cut")
        run.ticks(FULL)
        assert all(snapshot.present.all() for snapshot in run.snapshots)
        run.interrupt()
        assert run.finals["world"]["faults"] == []
        assert run.exit_codes("robot-2", "station", "world", "medium") == [0] * 4


def peak_kb(run: SmallRun, name: str) -> int:
    lines = Path(f"/proc/{run.processes[name].pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


def test_a_sender_that_floods_is_left_out_and_nobody_else() -> None:
    with small_run() as run:
        before = {name: peak_kb(run, name) for name in ("medium", "world")}
        run.start_rogue(flood, 2)
        run.until(lambda: not run.present(2), "robot 2 departed")
        assert any(text.startswith("robot 2: floods the run with messages") for text in told(run))
        run.until(lambda: run.processes["rogue"].exitcode is not None, "all is said")
        run.ticks(50)
        assert all(snapshot.present[[0, 2]].all() for snapshot in run.snapshots)
        for name, held_kb in before.items():
            assert peak_kb(run, name) - held_kb < MOST_GROWTH_KB, name
        run.start_robot(2, "again")
        run.until(lambda: run.present(2), "a new process of robot 2 takes part")
        run.ticks(50)
        assert run.present(2)
        run.interrupt()
        assert run.finals["medium"]["malformed"] > FLOOD / 10
        assert run.finals["world"]["wall_clock_faults"] == 1


def test_a_flood_of_beats_does_not_fill_the_link_to_the_world() -> None:
    """A full link, a token that is told over it and a login together would stop Zenoh's router for ever."""
    with small_run() as run, Session.connect(run.logins["robot-1"]) as early:
        run.signal("world", signal.SIGSTOP)
        run.start_rogue(beat_flood, 2)
        run.until(lambda: run.processes["rogue"].exitcode is not None, "all is said")
        early.declare(new_token("robot", 1))
        with Session.connect(run.logins["robot-1"]):
            run.signal("world", signal.SIGCONT)
            run.ticks(50)
        assert all(snapshot.present.all() for snapshot in run.snapshots)
        run.interrupt()
        assert run.finals["world"]["faults"] == []


def test_a_refused_process_is_told_once() -> None:
    with small_run() as run:
        run.start_rogue(impostor, 2)
        run.until(lambda: run.processes["rogue"].exitcode is not None, f"{ANSWERS} answers")
        run.ticks(10)
        assert told(run) == ["a process of robot 2 was refused: another living process is already robot 2"]
        assert all(snapshot.present.all() for snapshot in run.snapshots)
