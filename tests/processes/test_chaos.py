"""A hundred simulated seconds of chaos, and the bounds of its faults."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.chaos import EVERY_S, MOST_DOWN, chaos, plan
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


@pytest.mark.processes
def test_a_hundred_seconds_of_chaos(tmp_path: Path) -> None:
    outcome = chaos(1, 100.0, tmp_path / "run")
    assert outcome.problems == ()
    assert outcome.simulated_s == 100.0
