"""The execution of a study: what is run, what a lost worker costs, and how a study ends."""

from __future__ import annotations

import dataclasses
import signal
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from deploy.run_folder.status import ERROR
from deploy.study import main
from deploy.sweep.plan import load_study, points_of
from deploy.sweep.results import Results, differences
from deploy.sweep.row import run_point
from deploy.sweep.workers import Execution, LocalPool
from tests.helpers.studies import command, tiny
from tests.helpers.study_workers import die_once_told, pretend
from tests.helpers.waiting import alive, wait_until


class Threads:
    """Workers without processes."""

    at_once: int | None = 2

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(2)

    @property
    def executor(self) -> Executor:
        return self._executor

    def renew(self) -> None:
        raise AssertionError("no worker was lost")

    def close(self) -> None:
        self._executor.shutdown()


@pytest.fixture
def pool() -> Iterator[LocalPool]:
    workers = LocalPool(2)
    yield workers
    workers.close()


def test_only_what_is_missing_is_run(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    points = points_of(load_study(str(tiny(tmp_path, 5, 5.0))))
    results = claimed(tmp_path / "out")
    workers = Threads()
    for _, run in Execution(workers, "in-process", 1, pretend).results(points[:3]):
        results.add(run)
    todo = [point for point in points if point.key not in results.done()]
    assert todo == points[3:]
    workers.close()


def test_a_run_that_raises_is_a_row_with_its_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deploy.sweep.row._TOLD", set())
    good = points_of(load_study(str(tiny(tmp_path, 1, 2.0))))[0]
    bad, worse = (
        dataclasses.replace(good, key=key, toml=good.toml.replace("robots = 2", f"robots = {robots}"))
        for key, robots in (("bad", 0), ("worse", -1))
    )
    workers = Threads()
    rows = {point.key: run.row for point, run in Execution(workers, "in-process", 1).results([bad, worse, good])}
    workers.close()
    assert rows["bad"]["status"] == ERROR
    assert "robots" in rows["bad"]["error"]
    assert rows[good.key]["status"] == "time_limit"
    assert rows[good.key]["ticks"] == 20
    assert rows["worse"]["status"] == ERROR
    assert capsys.readouterr().err.count("Traceback") == 1, "hundreds of runs that fail alike print it once"


@pytest.mark.processes
def test_a_worker_that_dies_costs_its_own_run_only(tmp_path: Path, pool: LocalPool) -> None:
    points = points_of(load_study(str(tiny(tmp_path, 4, 5.0))))
    execution = Execution(pool, "in-process", 1, die_once_told)
    rows = {run.row["seed"]: run.row for _, run in execution.results(points)}
    assert {seed: found["status"] for seed, found in rows.items()} == {
        1: "searched", 2: ERROR, 3: "searched", 4: "searched",
    }  # fmt: skip
    assert "worker process died" in rows[2]["error"]


def stopped_by(number: signal.Signals, ask: list[str], parts: Path) -> int:
    """Stop a study after its next result; returns its exit status once its workers are gone too."""
    before = len(list(parts.glob("*.json")))
    with subprocess.Popen(ask, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as study:
        wait_until(lambda: len(list(parts.glob("*.json"))) > before, "one more result")
        workers = [child.pid for child in psutil.Process(study.pid).children(recursive=True)]
        study.send_signal(number)
        status = study.wait()
    wait_until(lambda: not any(map(alive, workers)), "the workers end with the study")
    return status


@pytest.mark.processes
def test_an_end_by_force_or_by_request_loses_only_what_was_running(tmp_path: Path) -> None:
    path, out = tiny(tmp_path, 6, 40.0), tmp_path / "out"
    ask = command(path, "--out", out, "--workers", 1)
    assert stopped_by(signal.SIGKILL, ask, out / "parts") == -signal.SIGKILL
    assert stopped_by(signal.SIGTERM, ask, out / "parts") == 130
    assert (out / "results.parquet").exists()
    before = len(Results(out).rows())
    assert before >= 2
    again = subprocess.run(ask, capture_output=True, text=True, check=True)
    assert f"6 runs, {before} of them done" in again.stdout
    assert len(Results(out).rows()) == 6
    assert (out / "tiny.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fig8"], "did you mean 'fig7'"),
        (["fig7", "--workers", "0"], "--workers 0"),
        (["nowhere/none.toml"], "No such file"),
        (["fig7", "fig6", "--out", "x"], "--out takes one study"),
        (["fig7", "report"], "report stands alone, or before buildings"),
        (["report", "fig7"], "report stands alone, or before buildings"),
        (["fig7", "--only", "radio.modell=disk"], "did you mean 'radio.model'"),
        (["fig7", "--only", "seed"], "expected KEY=VALUE"),
        (["fig7", "--only", "seed=999"], "--only seed=999: no run of the study is so"),
        (["fig7", "--compare", "nowhere"], "no results.parquet"),
        (["fig7", "--compare", "n" * 5000], "--compare"),
        (["fig7", "--out", "n" * 5000, "--plot-only"], "name too long"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("study.py: ")
    assert said.count("\n") == 1
    assert words in said


@pytest.mark.processes
def test_real_processes_give_the_same_row(tmp_path: Path) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 10.0))))[0]
    ours = run_point(point.key, point.variant, point.toml, "in-process", 1)
    theirs = run_point(point.key, point.variant, point.toml, "processes", 1)
    assert theirs.row["engine"] == "processes"
    assert differences([ours.row], [theirs.row]) == []
