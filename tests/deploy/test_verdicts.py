"""Which verdict is on which fault."""

from __future__ import annotations

from typing import Any

import pytest

from deploy.run_folder.verdicts import verdict_on
from deploy.scenario import load
from deploy.simulation import Observer, Simulation
from world.feed import Event

FAULTS = ["kill:2@1", "kill:3@1", "pause:random@1+2", "loss:0.3@1+1", "loss:0.5@1+1", "jam:0,1@1+1", "kill:2@2"]


Run = tuple[list[dict[str, Any]], list[Event]]
"""Verdicts and events."""


@pytest.fixture(scope="module")
def run() -> Run:
    events: list[Event] = []
    scenario = load("three_cells", {"robots": 5, "duration_s": 4.0, "fault": FAULTS})
    finals = Simulation(scenario, Observer(lambda _: None, events.append)).run().finals
    return finals["world"]["recoveries"], events


def found(run: Run, of: int | str) -> list[dict[str, Any]]:
    verdicts, events = run
    return list(filter(verdict_on(of, events), verdicts))


def test_a_fault_finds_its_own_verdict(run: Run) -> None:
    verdicts = run[0]
    assert len(verdicts) == len(FAULTS) - 1, "the last strikes who is dead already"
    for verdict, fault in zip(verdicts, FAULTS, strict=False):
        assert found(run, fault) == [verdict]
    assert [verdict["robot"] for verdict in verdicts[:2]] == [2, 3]


def test_a_role_is_known_by_whom_it_meant_too(run: Run) -> None:
    (verdict,) = found(run, "pause:random@1+2")
    assert verdict["robot"] in (1, 4, 5)
    assert found(run, f"pause:{verdict['robot']}@1+2") == [verdict]
    assert found(run, verdict["robot"]) == [verdict]
    assert found(run, "pause:random@1.04+2") == [verdict], "the same tick"


@pytest.mark.parametrize(
    "other",
    ["kill:4@1", "kill:2@2", "pause:random@2+2", "pause:random@1+3", "loss:0.4@1+1", "restart:2@1+1", "station"],
)
def test_no_other_fault_has_one(run: Run, other: str) -> None:
    assert found(run, other) == []


def test_what_is_no_fault_is_refused() -> None:
    with pytest.raises(ValueError, match="expected VERB:TARGET@T"):
        verdict_on("robot 4", [])
