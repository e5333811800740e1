"""What a user reads of processes that failed: their own line first, and each way to fail once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from deploy.failures import Crash, Failures
from deploy.in_process import run_in_process
from deploy.run_folder.writer import RunFolder
from deploy.scenario import ScenarioError, load
from deploy.screen.view import NoView
from tests.helpers.policies import CLIMBS, policies

__all__ = ["policies"]


def crash(program: str, file: str, **names: object) -> Crash:
    with pytest.raises((ValueError, ArithmeticError)) as failed:
        exec(compile(program, file, "exec"), {"load": load, **names})
    return of(failed.value)


def of(error: BaseException) -> Crash:
    """As if no test had called it: a test is none of our packages, either."""
    assert error.__traceback__ is not None
    return Crash.of(error.with_traceback(error.__traceback__.tb_next))


def test_the_users_own_line_stands_out() -> None:
    told = crash("\n\nload('three_cells', {'robots': 'many'})", "/home/me/own.py")
    assert told.headline.startswith("ScenarioError: ")
    assert told.headline.endswith("(/home/me/own.py, line 3)"), "not the line of ours that raised"
    assert told.traceback.splitlines()[1].strip() == 'File "/home/me/own.py", line 3, in <module>'
    assert "test_failures.py" not in told.traceback, "nor who called it"


def test_an_exception_of_ours_is_told_from_its_beginning() -> None:
    with pytest.raises(ScenarioError) as failed:
        load("three_cells", {"robots": "many"})
    told = of(failed.value)
    assert told.headline.startswith("ScenarioError: ")
    assert ".py, line" not in told.headline
    assert "in load" in told.traceback


def test_no_text_of_an_exception_is_repeated_at_any_length() -> None:
    told = crash("raise ValueError('x' * 10**6)", "/home/me/own.py")
    assert len(told.headline) < 300
    assert max(map(len, told.traceback.splitlines())) <= 304


def test_processes_that_fail_in_the_same_way_are_told_once() -> None:
    failures = Failures()
    program = "if n == 3:\n    1 / 0\nraise ArithmeticError(f'robot {n}')"
    for n in (5, 1, 3, 12, 2, 7, 8, 9):
        words = f"robot/{n} (pid {1000 + n}) exited with status 1"
        failures.crashed(f"robot/{n}", words, crash(program, "/home/me/own.py", n=n))
    failures.add("station: journal could not be written: File too large")
    first, other, last = failures.lines
    assert first.splitlines()[0] == (
        "robot/5 (pid 1005) exited with status 1: ArithmeticError: robot 5 (/home/me/own.py, line 3)"
    )
    assert first.count("Traceback") == 1
    assert first.splitlines()[-1] == (
        "    6 more failed in the same way: robot/1, robot/2, robot/7, robot/8, robot/9, ..."
    )
    assert other.splitlines()[0].startswith("robot/3 (pid 1003) exited with status 1: ZeroDivisionError")
    assert last.startswith("station: ")


def test_a_run_in_one_process_keeps_what_came_before_a_policy_raised(policies: Path, tmp_path: Path) -> None:
    scenario = load("three_cells", {"robots": 3, "duration_s": 10.0, "policy": "climbing:Climbs"})
    with RunFolder(tmp_path / "run", scenario) as folder:
        summary, failures = run_in_process(scenario, folder, NoView(), record=False)
    assert (summary["status"], summary["ticks"], summary["trace_sha256"]) == ("failed", CLIMBS, None)
    (told,) = failures
    assert list(failures) == summary["failures"]
    assert told.splitlines()[0].startswith("the run ended: ArithmeticError: robot 1 has had enough (")
    assert f"{policies / 'climbing.py'}, line " in told.splitlines()[0]
    assert (tmp_path / "run" / "metrics.csv").read_text().count("\n") == 1 + CLIMBS // 10


@pytest.fixture
def broken(policies: Path) -> Path:
    (policies / "no_syntax.py").write_text("x = = 3\n")
    (policies / "no_module.py").write_text("import nothing_of_this_name\n")
    (policies / "no_luck.py").write_text("\nx = {}['weights']\n")
    return policies


@pytest.mark.parametrize(
    ("module", "why"),
    [
        ("no_syntax", r"SyntaxError: invalid syntax \(\S+/no_syntax\.py, line 1\)"),
        ("no_module", r"No module named 'nothing_of_this_name' \(\S+/no_module\.py, line 1\)"),
        ("no_luck", r"KeyError: 'weights' \(\S+/no_luck\.py, line 2\)"),
        ("not_there", r"No module named 'not_there'"),
    ],
)
def test_a_policy_that_can_not_be_imported_is_refused_in_one_line(broken: Path, module: str, why: str) -> None:
    assert broken
    with pytest.raises(ScenarioError) as refused:
        load("three_cells", {"policy": f"{module}:Own"})
    assert re.fullmatch(rf"three_cells: policy = '{module}:Own': cannot import {module}: {why}", str(refused.value))
