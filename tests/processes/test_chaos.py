"""Chaos: its plans, some short runs, and that its checks notice what does not hold."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from tests.chaos.ending import AS_ASKED, Expected, problems
from tests.chaos.missions import EVERY_S, MOST_DOWN, chaos, plan
from tests.chaos.outcome import kind_of, outcome_of
from tests.chaos.short_run import ShortRun
from tests.chaos.troubles import KINDS
from world.faults import check_fault, parse_fault


@pytest.mark.parametrize("seed", range(1, 6))
def test_the_plan_keeps_to_its_bounds(seed: int) -> None:
    faults = [parse_fault(text) for text in plan(seed, 1000.0)]
    assert plan(seed, 1000.0) == plan(seed, 1000.0)
    assert [fault.at_s for fault in faults] == [k * EVERY_S for k in range(1, 100)]
    assert {fault.verb for fault in faults} == {"restart", "pause", "jam", "loss"}
    spans = [(f.at_s, f.at_s + (f.for_s or 0.0)) for f in faults if f.verb in ("restart", "pause")]
    for at_s, _ in spans:
        assert sum(start <= at_s < end for start, end in spans) <= MOST_DOWN
    for fault in faults:
        check_fault(fault, 12, 1000.0)


def test_every_kind_has_its_turn() -> None:
    assert {kind_of(seed) for seed in range(1, 1 + len(KINDS))} == set(KINDS)


@pytest.mark.processes
def test_a_hundred_seconds_of_chaos(tmp_path: Path) -> None:
    outcome = chaos(1, 100.0, tmp_path / "run")
    assert outcome.problems == ()
    assert outcome.simulated_s == 100.0


@pytest.mark.processes
@pytest.mark.parametrize("kind", ["robots_die", "rogue_talks_nonsense", "disk_is_small", "launcher_dies"])
def test_a_short_run_ends_as_documented(kind: str) -> None:
    outcome = outcome_of(1, kind)
    assert outcome.expected == ()
    assert outcome.met


@pytest.mark.processes
def test_what_does_not_hold_is_noticed(tmp_path: Path) -> None:
    run = ShortRun(1, random.Random(1), tmp_path)
    run.begin()
    run.reach("before the first tick")
    run.strike("robot/2", signal.SIGKILL)
    run.strikes.clear()  # as if nobody had done it
    (run.place.path / "left").touch()
    said = problems(run, Expected({130: ()}, also=("nothing else",)))
    assert said[0] == "nothing else"
    assert said[1] == "no temporary file left, and there are ['left']"
    assert said[2].startswith("exit status 130, and it was 0")
    assert said[3].startswith("no faults but of [], and there are of ['robot/2']")
    summary = run.out / "summary.json"
    summary.write_text(summary.read_text().replace('"trace_sha256": "', '"trace_sha256": "0'))
    (run.place.path / "left").unlink()
    (again,) = problems(run, Expected(AS_ASKED, faulty=frozenset({"robot/2"})))
    assert again.startswith("the digest of the replay, and it was another")
