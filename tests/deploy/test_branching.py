"""Branches of a run: each is, to the bit, a run of its scenario from the start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.branching import BranchError, branch
from deploy.scenario import Scenario, ScenarioError, load, parse_set, with_changes
from deploy.simulation import Result, Simulation
from tests import ROOT
from tests.helpers.waiting import alive, wait_until

SHORT = {"robots": 4, "radius_m": 9.0, "duration_s": 20.0}
FORMS = (
    "kill:random@{}", "kill:sr:far@{}", "kill:relay:first@{}", "restart:2@{}+3", "pause:1@{}+2.5", "jam:0,1@{}+4",
    "loss:0.5@{}+2", "restart:station@{}+3", "radio.loss=0.4", "radio.model=disk_los", "radio.burst_share=0.3",
)  # fmt: skip


def at(form: str, at_s: float) -> Any:
    _, is_change, _ = form.partition("=")
    if not is_change:
        return form.format(at_s)
    return {"at_s": at_s, "set": dict([parse_set(form)])}


def from_the_start(scenario: Scenario, faults: list[Any]) -> Result:
    return Simulation(with_changes(scenario, faults)).run()


def same(left: Result, right: Result) -> bool:
    ours, theirs = left.traces, right.traces
    return left.finals == right.finals and all(
        np.array_equal(getattr(ours, name), getattr(theirs, name)) for name in ("present", "xy_m", "cls", "nms", "hops")
    )


@settings(max_examples=3)
@given(
    st.sampled_from(["vds", "scout"]), st.integers(0, 50), st.integers(1, 120),
    st.lists(
        st.tuples(st.lists(st.sampled_from(FORMS), min_size=1, max_size=3), st.integers(0, 60)),
        min_size=1, max_size=3,
    ),
)  # fmt: skip
def test_a_branch_is_a_run_of_its_scenario_from_the_start(
    policy: str, seed: int, tick: int, drawn: list[tuple[list[str], int]]
) -> None:
    scenario = load("three_cells", SHORT | {"policy": policy, "seed": seed, "fault": ["kill:random@8"]})
    scenario = with_changes(scenario, [{"at_s": 6.0, "set": {"radio.loss": 0.1}}])
    futures = [[at(form, (tick + later) / 10) for form in forms] for forms, later in drawn]
    for result, faults in zip(branch(scenario, tick / 10, futures), futures, strict=True):
        assert same(result, from_the_start(scenario, faults))


def test_each_branch_has_a_future_of_its_own() -> None:
    scenario = load("three_cells", SHORT)
    none, kill, again = branch(scenario, 10.0, [[], ["kill:2@10"], []])
    assert none.trace_sha256 == again.trace_sha256 == Simulation(scenario).run().trace_sha256
    assert kill.trace_sha256 != none.trace_sha256
    assert [fault["target"] for fault in kill.finals["world"]["faults"]] == ["2"]


def test_a_run_that_a_branch_alone_prolongs() -> None:
    dead = load("three_cells", SHORT | {"robots": 1, "fault": ["kill:1@5"]})
    (result,) = branch(dead, 12.0, [["restart:1@12+1"]])
    assert result.finals["world"]["ticks"] == 200
    assert same(result, from_the_start(dead, ["restart:1@12+1"]))


def test_what_a_branch_cannot_do_is_refused_in_one_line() -> None:
    scenario = load("three_cells", SHORT)
    with pytest.raises(ScenarioError, match=r"'kill:2@9\.9' acts before the branch at at_s = 10$"):
        branch(scenario, 10.0, [["kill:2@9.9"]])
    with pytest.raises(ScenarioError, match=r"a change at at_s = 9 acts before the branch at at_s = 10$"):
        branch(scenario, 10.0, [[{"at_s": 9.0, "set": {"radio.loss": 0.1}}]])
    with pytest.raises(ScenarioError, match="there are only robots 1 to 4"):
        branch(scenario, 10.0, [["kill:5@12"]])
    with pytest.raises(ScenarioError, match="not within the run's duration_s = 20"):
        branch(scenario, 10.0, [["kill:1@20"]])


BAD = """
import threading
from agents.vds import Vds

class Failing(Vds):
    def __init__(self, *args, **keys):
        super().__init__(*args, **keys)
        raise RuntimeError("no such luck")

class Threaded(Vds):
    def __init__(self, *args, **keys):
        super().__init__(*args, **keys)
        threading.Thread(target=threading.Event().wait, daemon=True).start()
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Failing", "the past of the branches: RuntimeError: no such luck"),
        ("Threaded", "can't be branched while it has threads"),
    ],
)
def test_a_policy_that_fails_is_told_in_one_line(
    name: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad_branch.py").write_text(BAD)
    monkeypatch.syspath_prepend(str(tmp_path))
    scenario = load("three_cells", SHORT | {"policy": f"bad_branch:{name}"})
    with pytest.raises(BranchError, match=words):
        branch(scenario, 1.0, [["kill:1@2"]])
    sys.modules.pop("bad_branch")


ENDLESS = """
from deploy.branching import branch
from deploy.scenario import load
scenario = load("three_cells", {"robots": 2, "radius_m": 8.0, "duration_s": 1e6})
branch(scenario, 0.5, [["kill:1@1"], ["kill:2@1"]], at_once=2)
"""


def test_all_processes_end_with_the_one_that_asked() -> None:
    with subprocess.Popen([sys.executable, "-c", ENDLESS], cwd=ROOT) as asking:
        try:
            me = psutil.Process(asking.pid)
            wait_until(lambda: len(me.children(recursive=True)) == 3, "both branches are under way")
            pids = [process.pid for process in me.children(recursive=True)]
        finally:
            os.kill(asking.pid, signal.SIGKILL)
    wait_until(lambda: not any(map(alive, pids)), "all have ended")
