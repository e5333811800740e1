"""However a run or its owner ends, it leaves no process, no temporary file and no password."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from deploy.machine.interrupts import SIGNALS
from deploy.processes.operator_file import OPERATOR
from tests import ROOT
from tests.helpers.place import Place
from tests.helpers.running import LONG, Running
from tests.helpers.waiting import wait_until

pytestmark = pytest.mark.processes

Start = Callable[..., Running]


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with tempfile.TemporaryDirectory(prefix="t-", dir="/tmp") as folder:
        yield Place(Path(folder), tmp_path)


STAGES: dict[str, Callable[[Running, Place], bool]] = {
    "the command has begun": lambda running, _: running.process.poll() is None,
    "the janitor waits": lambda _, place: bool(place.janitors()),
    "the run folder is claimed": lambda running, _: (running.out / "metrics.csv").exists(),
    "the fork server listens": lambda _, place: "listener" in place.names(),
    "the first process has begun": lambda running, _: any((running.out / "logs").glob("*.log")),
    "the router opens": lambda _, place: "router.lock" in place.names(),
    "the operator may enter": lambda running, _: (running.out / OPERATOR).exists(),
    "all processes have begun": lambda running, _: bool(running.pids()),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("stage", STAGES)
def test_a_run_that_is_ended_while_it_starts_leaves_nothing(
    start: Start, place: Place, stage: str, number: signal.Signals
) -> None:
    running = start(*LONG, environment=place.environment)
    wait_until(lambda: STAGES[stage](running, place), stage)
    running.process.send_signal(number)
    status, _, errors = running.ended()
    place.assert_clean()
    assert not (running.out / OPERATOR).exists()
    if number == signal.SIGKILL:
        return
    if (running.out / "summary.json").exists():
        assert (status, errors, running.summary()["status"]) == (0, "", "interrupted")
    elif stage != "the command has begun":  # when Python itself may not have begun yet
        assert status == 130
        assert not running.out.exists()


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_to_the_whole_group_ends_the_run_in_order(start: Start, place: Place, number: signal.Signals) -> None:
    """As a terminal or `timeout` sends it."""
    running = start(*LONG, environment=place.environment)
    running.wait_for(3)
    os.killpg(running.process.pid, number)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["status"] == "interrupted"
    place.assert_clean()


@pytest.mark.parametrize("engine", [(), ("--in-process",)], ids=["processes", "in process"])
def test_who_presses_ctrl_c_again_and_again_gets_the_status_of_an_interrupted_run(
    start: Start, place: Place, engine: tuple[str, ...]
) -> None:
    running = start(*LONG, *(engine or ("--speed", 20)), environment=place.environment)
    wait_until(lambda: running.rows() > 3, "some seconds are simulated")
    with contextlib.suppress(ProcessLookupError):
        while running.process.poll() is None:
            running.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.process.wait(0.01)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["status"] == "interrupted"
    place.assert_clean()


def test_a_run_that_is_killed_with_its_janitor_is_swept_away_by_the_next(start: Start, place: Place) -> None:
    running = start(*LONG, environment=place.environment)
    pids = running.wait_for(1)
    for pid in (*place.janitors(), pids["launcher"]):
        os.kill(pid, signal.SIGKILL)
    running.ended()
    wait_until(lambda: not place.processes(), "no process is left")
    assert "router" in place.names()
    (place.path / "vds-my-own").mkdir()
    (place.path / "vds-0123456789ab").mkdir()
    following = start("--robots", 2, "--duration", 1, environment=place.environment)
    assert following.ended()[0] == 0
    assert {path.name for path in place.path.iterdir()} == {"vds-my-own", "vds-0123456789ab"}, "others' stay"


OWNER = """
import json, sys
from pathlib import Path
from deploy.emulation import Emulation

run = Emulation("three_cells", Path(sys.argv[1]), robots=3, radius_m=8.0, duration_s=100_000.0)
print(json.dumps(run.pids), flush=True)
run.wait_for(100_000.0, 3000.0)
"""


def test_a_run_ends_with_the_test_that_holds_it(place: Place, tmp_path: Path) -> None:
    """Even if that test is killed."""
    command = [sys.executable, "-c", OWNER, str(tmp_path / "run")]
    environment = {**os.environ, **place.environment}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment) as owner:
        assert owner.stdout is not None
        assert "launcher" in owner.stdout.readline()
        owner.kill()
    place.assert_clean()
    assert not (tmp_path / "run" / OPERATOR).exists()
    assert '"interrupted"' in (tmp_path / "run" / "summary.json").read_text()


STUDY = """
name = "endless"
scenario = "three_cells"
plot = "search_time"
[set]
robots = 3
duration_s = 90000.0
[axes]
radius_m = [8.0]
seed = "1..2"
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_study_leaves_nothing_either(place: Place, tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "endless.toml").write_text(STUDY)
    command = [sys.executable, str(ROOT / "deploy" / "study.py"), "endless.toml", "--workers", "2", "--out", "out"]
    environment = {**os.environ, **place.environment}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as study:
        wait_until(lambda: "events.jsonl" in place.names(), "a run is under way")
        study.send_signal(number)
        _, errors = study.communicate()
    assert study.returncode == (-signal.SIGKILL if number == signal.SIGKILL else 130), errors
    place.assert_clean()
