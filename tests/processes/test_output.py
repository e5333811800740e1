"""A run outlives the terminal, the pipe and the disk that it writes to, and says what is missing."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.emulation import Emulation
from deploy.in_process import run_in_process
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from deploy.screen.view import NoView
from tests import ROOT
from tests.helpers.running import LONG, Running, assert_readable, gone
from tests.helpers.waiting import wait_until

pytestmark = pytest.mark.processes

SHORT = ("--robots", 3, "--duration", 10)
Start = Callable[..., Running]
ENGINES = pytest.mark.parametrize("engine", [(), ("--in-process",)], ids=["processes", "in process"])


def limited(kilobytes: int) -> Callable[[], None]:
    """What a process does first to be allowed files of so many kilobytes only."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes * 1024, kilobytes * 1024))


@ENGINES
def test_a_reader_that_leaves_does_not_end_the_run(start: Start, engine: tuple[str, ...]) -> None:
    """As `| head -1` does."""
    running = start(*SHORT, *engine)
    assert running.process.stdout is not None
    assert running.process.stdout.readline().startswith("run folder")
    running.process.stdout.close()
    running.process.stdout = None
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["status"] == "time_limit"


@ENGINES
def test_a_full_disk_behind_standard_output_is_told_and_costs_nothing_else(
    start: Start, engine: tuple[str, ...]
) -> None:
    with Path("/dev/full").open("wb") as full:
        running = start(*SHORT, *engine, stdout=full.fileno())
    status, _, errors = running.ended()
    assert (status, errors) == (1, "run_local.py: standard output could not be written: No space left on device\n")
    assert (running.summary()["status"], running.summary()["failures"]) == ("time_limit", [])


def test_standard_output_that_is_closed_is_no_file_of_the_run(start: Start) -> None:
    running = start(*SHORT, first=lambda: os.close(1))
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert b"run folder" not in b"".join(path.read_bytes() for path in running.out.rglob("*") if path.is_file())


@ENGINES
def test_a_terminal_that_is_gone_is_no_matter(start: Start, engine: tuple[str, ...]) -> None:
    """Every write fails with EIO then; nobody sends a signal, as the terminal did not control the run."""
    terminal, slave = os.openpty()
    running = start(*SHORT, *(engine or ("--speed", 20)), stdout=slave)
    os.close(slave)
    os.read(terminal, 1)
    os.close(terminal)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["status"] == "time_limit"


@ENGINES
def test_a_run_ends_in_order_with_the_terminal_that_controls_it(start: Start, engine: tuple[str, ...]) -> None:
    """The kernel sends SIGHUP to all its processes then."""
    terminal, slave = os.openpty()
    running = start(*LONG, *(engine or ("--speed", 20)), stdout=slave, first=lambda: os.login_tty(slave))
    os.close(slave)
    wait_until(lambda: running.rows() > 3, "some seconds are simulated")
    os.close(terminal)
    assert running.ended()[0] == 0
    assert running.summary()["status"] == "interrupted"
    assert gone(running.pids())
    assert_readable(running.out / "recording.rrd")


@ENGINES
def test_hanging_up_ends_a_run_in_order_but_for_nohup(start: Start, engine: tuple[str, ...]) -> None:
    def nohup() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    running, kept = start(*LONG, *(engine or ("--speed", 20))), start(*LONG, *(engine or ("--speed", 20)), first=nohup)
    for each in (running, kept):
        wait_until(lambda: each.rows() > 3, "some seconds are simulated")  # noqa: B023  # called at once
        each.hang_up()
    assert running.ended()[::2] == (0, "")
    assert running.summary()["status"] == "interrupted"
    seen = kept.rows()
    wait_until(lambda: kept.rows() > seen + 3, "the other goes on")
    kept.process.terminate()
    assert kept.ended()[::2] == (0, "")


@ENGINES
def test_a_recording_that_is_cut_off_is_named_in_one_line(start: Start, engine: tuple[str, ...]) -> None:
    running = start("--robots", 3, "--duration", 60, *engine, first=limited(100))
    status, _, errors = running.ended()
    assert status == 1
    assert errors.count("\n") == 1, errors
    assert "recording.rrd could not be written: File too large" in errors
    summary = running.summary()
    assert (summary["status"], len(summary["failures"])) == ("time_limit", 1)
    assert 80 * 1024 <= (running.out / "recording.rrd").stat().st_size <= 100 * 1024
    assert (running.out / "map.yaml").exists()


def test_all_that_can_not_be_written_is_named_and_the_rest_is_whole(start: Start) -> None:
    running = start("--robots", 4, "--duration", 300, "--no-recording", first=limited(8))
    status, _, errors = running.ended()
    assert status == 1
    named = ("journal", "map.yaml", "metrics.csv")
    assert all(f"{name} could not be written: File too large" in errors for name in named), errors
    assert "Traceback" not in errors
    summary = running.summary()
    assert (summary["status"], summary["scan_reports"]["lost"]) == ("time_limit", 0)
    assert not list(running.out.glob("map*")), "half a map is none"
    assert (running.out / "metrics.csv").read_bytes().endswith(b"\n"), "nor is half a row one"


def test_a_summary_that_can_not_be_written_is_named(tmp_path: Path) -> None:
    scenario = load("three_cells", {"robots": 1, "duration_s": 1.0})
    with RunFolder(tmp_path / "run", scenario) as folder:
        (tmp_path / "run" / "summary.json").mkdir()
        summary, failures = run_in_process(scenario, folder, NoView(), record=False)
    assert summary["status"] == "time_limit"
    assert failures == ("summary.json could not be written: Is a directory",)
    assert not list((tmp_path / "run").glob("*.part"))


def test_the_map_of_a_dead_station_is_made_from_its_journal(tmp_path: Path) -> None:
    options: dict[str, Any] = {"robots": 4, "duration_s": 40.0}
    faults = ["kill:station@30"]
    with Emulation("three_cells", tmp_path / "many", faults=faults, **options) as run:
        many = run.summary
    scenario = load("three_cells", {**options, "fault": faults})
    with RunFolder(tmp_path / "one", scenario) as folder:
        one, _ = run_in_process(scenario, folder, NoView(), record=False)
    for key in ("trace_sha256", "scan_reports", "search_rate", "victims", "recoveries"):
        assert many[key] == one[key], key
    assert many["scan_reports"]["merged"] > 0
    for name in ("map.yaml", "map.pgm"):
        assert (tmp_path / "many" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()


@pytest.mark.parametrize("command", [["report.py", "RUN"], ["ctl.py", "--help"], ["study.py", "--help"]])
def test_the_other_commands_too(tmp_path: Path, command: list[str]) -> None:
    scenario = load("three_cells", {"robots": 1, "duration_s": 1.0})
    with RunFolder(tmp_path / "run", scenario) as folder:
        run_in_process(scenario, folder, NoView(), record=False)
    words = [word.replace("RUN", str(tmp_path / "run")) for word in command]
    asked = [sys.executable, str(ROOT / "deploy" / words[0]), *words[1:]]
    read, write = os.pipe()
    os.close(read)
    with Path("/dev/full").open("wb") as full, os.fdopen(write, "wb") as pipe:
        for stdout, status, lines in (pipe, 0, 0), (full, 1, 1):
            ended = subprocess.run(asked, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False)
            assert (ended.returncode, ended.stderr.count("\n")) == (status, lines), ended.stderr
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "time_limit"
