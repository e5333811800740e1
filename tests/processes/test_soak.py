"""The soak in short, the bounds of its faults, and that it notices what grew."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.soak import GROWTH_KB, OLD, Memory, grown, plan, soak
from world.faults import check_fault, parse_fault


@pytest.mark.parametrize("seed", range(1, 4))
def test_the_plan_keeps_to_its_bounds(seed: int) -> None:
    texts = plan(seed, 7200.0, 3)
    assert texts == plan(seed, 7200.0, 3)
    faults = [parse_fault(text) for text in texts]
    assert {fault.verb for fault in faults} == {"kill", "restart", "pause", "jam", "loss"}
    away_until_s: dict[str, float] = {}
    for fault in sorted(faults, key=lambda fault: fault.at_s):
        check_fault(fault, 3, 7200.0)
        if fault.verb in ("kill", "restart"):
            assert fault.target != "1"
            assert fault.target != "station" or fault.at_s < 1900.0
        if fault.verb in ("restart", "pause"):
            assert away_until_s.get(fault.target, 0.0) <= fault.at_s
            away_until_s[fault.target] = fault.at_s + (fault.for_s or 0.0)


def test_it_notices_what_grew_and_what_is_another_process() -> None:
    middle = {name: Memory(pid, 50_000, 20_000) for pid, name in enumerate(OLD)}
    assert list(grown({"middle": middle, "end": middle})) == []
    leaks = Memory(middle["medium"].pid, 50_001 + GROWTH_KB, 20_000)
    assert list(grown({"middle": middle, "end": {**middle, "medium": leaks}})) == [
        f"medium grew from 50000 to {50_001 + GROWTH_KB} kB (rss)"
    ]
    another = Memory(99, 50_000, 20_000)
    assert list(grown({"middle": middle, "end": {**middle, "world": another}})) == [
        "world is not the process that it was"
    ]


@pytest.mark.processes
def test_three_minutes_of_it(tmp_path: Path) -> None:
    outcome = soak(1, 180.0, tmp_path)
    assert outcome.problems == ()
    assert outcome.simulated_s == 180.0
    assert list(outcome.samples) == ["start", "middle", "end"]
