"""Criticality: every failure in a branch of its own, the verdict on all of them, and how an analysis goes on."""

from __future__ import annotations

import contextlib
import csv
import functools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from deploy.branching.branches import answers
from deploy.branching.trunk import Branch, Order
from deploy.criticality.analysis import row_of
from deploy.criticality.failure import Failure, fail, lacking
from deploy.criticality.picture import over_the_floor, over_time
from deploy.criticality.results import Results
from deploy.criticality.verdict import case_of, name_of, verdict_on
from deploy.scenario import load, with_changes
from deploy.simulation import Simulation
from deploy.whatif import main
from tests import ROOT
from tests.helpers.waiting import alive, wait_until
from world.terms import seconds_of

CORRIDOR = str(ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml")
"""At 24 s its robots stand in a chain of three hops and more."""
FEW = ("--duration", "34", "--every", "12", "--horizon", "15")


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whatif") / "out"
    assert main([CORRIDOR, *FEW, "--out", str(folder)]) == 0
    return folder


def rows(folder: Path) -> list[dict[str, Any]]:
    return pq.read_table(folder / "criticality.parquet").to_pylist()  # type: ignore[no-any-return]


def test_every_robot_fails_at_every_moment(analysed: Path) -> None:
    robots = load(CORRIDOR).robots
    found = rows(analysed)
    assert [(row["at_s"], row["robot"]) for row in found] == [
        (at_s, robot) for at_s in (12.0, 24.0) for robot in range(1, robots + 1)
    ]
    with (analysed / "criticality.csv").open(newline="") as file:
        assert [row["cost_robot_s"] for row in csv.DictReader(file)] == [str(row["cost_robot_s"]) for row in found]
    assert (analysed / "criticality.png").stat().st_size > 10_000
    assert "What would it cost to lose this robot" in (analysed / "criticality.svg").read_text()


def test_a_row_tells_what_a_whole_run_with_that_failure_shows(analysed: Path) -> None:
    row = max(rows(analysed), key=lambda row: row["cost_robot_s"])
    assert row["orphans"] > 0
    assert row["cost_robot_s"] > 0
    scenario = load(CORRIDOR, {"duration_s": 34.0})
    run = Simulation(with_changes(scenario, [f"kill:{row['robot']}@{row['at_s']}"])).run()
    (verdict,) = run.finals["world"]["recoveries"]
    assert row["orphans"] == len(verdict["orphaned"])
    begun = round(row["at_s"] * 10)
    missing = [lacking(snapshot) for snapshot in run.snapshots[begun : begun + round(row["watched_s"] * 10)]]
    assert row["without_path_robot_s"] == seconds_of(sum(missing))
    assert row["recovered"] == (missing[-1] == 0)
    if row["recovered"]:
        last = max((k for k, count in enumerate(missing) if count), default=-1)
        assert row["back_s"] == seconds_of(last + 1)
    place = run.snapshots[begun].xy_m[row["robot"] - 1].tolist()
    assert [row["x_m"], row["y_m"]] == place


def test_a_branch_ends_once_everybody_was_back_for_ten_seconds(analysed: Path) -> None:
    ends = {row["ended"] for row in rows(analysed)}
    assert "back" in ends
    for row in rows(analysed):
        if row["ended"] == "back":
            assert row["watched_s"] == pytest.approx(row["back_s"] + 10.0)


@pytest.mark.parametrize("verb", ["pause", "restart"])
def test_a_robot_that_comes_back_must_have_a_path_too(verb: Any, analysed: Path) -> None:
    scenario = load(CORRIDOR, {"duration_s": 60.0})
    nobody_behind = next(row["robot"] for row in rows(analysed) if row["at_s"] == 24.0 and not row["orphans"])
    failure = Failure(verb, 12.0, 40.0, to_end=False)
    branch = Branch("one", 240, with_changes(scenario, [failure.fault(nobody_behind, 240)]))
    ((_, told),) = answers(Order(scenario, [branch], functools.partial(fail, failure=failure), 1, keeps=False))
    assert told["orphans"] == 0
    assert told["recovered"]
    assert told["back_s"] >= 12.0


def test_to_the_end_tells_what_a_failure_cost_the_search() -> None:
    mission = {
        "missing": [0] * 100 + [2] * 30, "places": {"100": {"4": [1.0, 2.0]}}, "search_time_s": 300.0,
        "victims": {"0": 90, "1": 150, "2": 200, "3": 250},
    }  # fmt: skip
    told = {
        "orphans": 2, "recovered": True, "back_s": 5.0, "without_path_robot_s": 8.0, "watched_s": 15.0, "ended": "back",
        "search_time_s": 312.5, "victims": {"0": 100, "1": 160, "2": 190},
    }  # fmt: skip
    found = row_of("4@100", told, mission, Failure("kill", None, 90.0, to_end=True))
    assert found["anyway_robot_s"] == 6.0
    assert found["cost_robot_s"] == 2.0
    assert (found["x_m"], found["y_m"]) == (1.0, 2.0)
    assert (found["search_time_lost_s"], found["victims_later"], found["victims_missed"]) == (12.5, 1, 1)


def test_a_branch_can_go_on_to_the_end_of_its_mission() -> None:
    scenario = load(CORRIDOR, {"duration_s": 34.0})
    failure = Failure("kill", None, 15.0, to_end=True)
    branch = Branch("2@100", 100, with_changes(scenario, [failure.fault(2, 100)]))
    ((_, told),) = answers(Order(scenario, [branch], functools.partial(fail, failure=failure), 1, keeps=False))
    assert told["ticks"] == 340
    assert told["watched_s"] <= 15.0
    run = Simulation(branch.scenario).run()
    assert sorted(map(int, told["victims"])) == run.finals["station"]["victims_found"]
    assert all(int(victim) in run.snapshots[tick].victims_found for victim, tick in told["victims"].items())


def row(cost: float, *, back_s: float | None, watched_s: float = 90.0, robot: int = 1, at_s: float = 10.0) -> Any:
    return {
        "robot": robot, "at_s": at_s, "recovered": back_s is not None, "back_s": back_s, "watched_s": watched_s,
        "cost_robot_s": cost, "orphans": 1, "x_m": 20.0, "y_m": 30.0,
    }  # fmt: skip


def test_the_verdict_counts_who_is_back_and_leaves_open_what_ended_too_soon() -> None:
    slow, never = row(70.0, back_s=70.0), row(200.0, back_s=None, robot=2)
    found = verdict_on([row(0.0, back_s=0.0), row(9.0, back_s=60.0), slow, never, row(9.0, back_s=None, watched_s=20)])
    assert (found.judged, found.back, found.open) == (4, 2, 1)
    assert list(found.harmful) == [never, slow]
    assert found.words.startswith(
        "after 50.0% of 4 single failures everybody is back within 60 s; 1 more came too late"
    )


def test_the_picture_has_each_failure_at_its_time_and_place() -> None:
    found = [row(5.0, back_s=1.0, robot=7, at_s=20.0), row(3.0, back_s=1.0, robot=2), row(1.0, back_s=1.0, robot=7)]
    robots, cost = over_time(found, 10.0)
    assert robots == [2, 7]
    assert np.array_equal(cost, [[3.0, np.nan], [1.0, 5.0]], equal_nan=True)
    arena = load("three_cells").arena
    side_m, floor = over_the_floor(found, arena)
    assert floor[int(30 / side_m), int(20 / side_m)] == pytest.approx(3.0)
    assert np.count_nonzero(~np.isnan(floor)) == 1


def test_each_harmful_failure_is_a_scenario_that_can_be_run(tmp_path: Path) -> None:
    scenario = load(CORRIDOR, {"fault": ["pause:1@5+2"]})
    failure = Failure("restart", 4.0, 90.0, to_end=False)
    harm = row(200.0, back_s=None, robot=4, at_s=24.0)
    folder = tmp_path / "out"
    with contextlib.closing(Results(folder, {}, scenario.to_toml())) as results:
        results.write_cases({"kill-9-9.toml": "an earlier one"})
        results.write_cases({name_of(harm, failure): case_of(harm, failure, scenario)})
    (path,) = (folder / "cases").iterdir()
    assert path.read_text().startswith("# restart of robot 4 at 24 s, with 1 robots behind it: after 90 s somebody is")
    assert load(path).tables == with_changes(scenario, ["restart:4@24+4"]).tables


ONCE = """
from agents.vds import Vds

class Once(Vds):
    made = 0

    def __init__(self, *args, **keys):
        super().__init__(*args, **keys)
        Once.made += 1
        if Once.made == 3:
            raise RuntimeError("a third robot")
"""


def test_a_branch_that_fails_costs_its_row_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "once.py").write_text(ONCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    out = ("--duration", "8", "--every", "4", "--horizon", "3", "--out", "out")
    restart = ("three_cells", "--robots", "2", "--policy", "once:Once", "--verb", "restart", "--away", "1")
    assert main([*restart, *out]) == 1
    sys.modules.pop("once")
    told = capfd.readouterr()
    assert told.out.count("a third robot") == 2
    assert "2 branches failed; the same command tries them again" in told.err
    assert "no failure has a result" in told.out
    assert (tmp_path / "out" / "rows.jsonl").read_text() == ""


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--verb", "jam"], "--verb jam: expected kill, pause, restart"),
        (["--away", "5"], "--away is for pause and restart"),
        (["--every", "0"], "--every 0: a multiple of 0.1 s"),
        (["--horizon", "0.25"], "--horizon 0.25: a multiple of 0.1 s"),
        (["--workers", "0"], "--workers 0: at least 1"),
        (["--robots", "0"], "robots = 0"),
        (["nowhere"], "unknown scenario 'nowhere'"),
        (["--out", "taken"], "taken: holds mine.txt, which no whatif.py wrote"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine.txt").touch()
    assert main(options) == 2
    told = capsys.readouterr()
    assert words in told.err
    assert told.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["mine.txt", "taken"]


def test_an_analysis_of_something_else_is_not_mixed_in(analysed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (analysed / "rows.jsonl").read_bytes()
    assert main([CORRIDOR, *FEW, "--seed", "2", "--out", str(analysed)]) == 2
    assert main([CORRIDOR, *FEW, "--verb", "pause", "--out", str(analysed)]) == 2
    assert capsys.readouterr().err.count("name another --out\n") == 2
    assert (analysed / "rows.jsonl").read_bytes() == before


def test_an_interrupted_analysis_goes_on_where_it_stopped(analysed: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = [sys.executable, str(ROOT / "deploy" / "whatif.py"), CORRIDOR, *FEW, "--out", str(folder)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        try:
            kept = folder / "rows.jsonl"
            wait_until(lambda: kept.exists() and kept.read_bytes().count(b"\n") >= 2, "two branches have ended")
            os.kill(running.pid, signal.SIGINT)
            _, errors = running.communicate()
        finally:
            running.kill()
    assert running.returncode == 130
    assert b"interrupted; the same command goes on from here" in errors
    some = rows(folder)
    assert 2 <= len(some) < len(rows(analysed))
    assert not alive(running.pid)
    with kept.open("a") as file:
        file.write('{"robot": 3, "at_')  # what a kill leaves
    subprocess.run(command, cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    assert rows(folder) == rows(analysed)
    assert kept.read_text().splitlines()[: len(some)] == [json.dumps(row) for row in some]
