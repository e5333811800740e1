"""What a new run takes from an earlier one, and the fate of scan reports that a fault delayed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from deploy.run_folder.baseline import Baseline, faults_of
from deploy.run_folder.verdicts import information_age, lost_reports, settle
from deploy.scenario import ScenarioError, load

KILL = {"verb": "kill", "at_s": 5.0, "target": "2"}


def past(folder: Path, **summary: Any) -> Path:
    folder.mkdir()
    (folder / "scenario.toml").write_text(load("three_cells", {"robots": 3}).to_toml())
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def test_the_faults_of_a_run_take_the_place_of_its_scenarios(tmp_path: Path) -> None:
    folder = past(tmp_path / "run", faults=[KILL])
    assert faults_of(folder) == [KILL]
    own = tmp_path / "own.toml"
    own.write_text(load("three_cells", {"fault": ["kill:1@9"]}).to_toml())
    replayed = load(own, {"fault": faults_of(folder)}, own_faults=False)
    assert [(f.verb, f.at_s, f.target) for f in replayed.tables.fault] == [("kill", 5.0, "2")]


@pytest.mark.parametrize("text", [None, "no json", "[]", "{}"])
def test_no_run_is_one_clear_line(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    with pytest.raises(ScenarioError, match=r"summary\.json") as error:
        faults_of(tmp_path)
    assert "\n" not in str(error.value)


def test_search_time_lost_by_cell(tmp_path: Path) -> None:
    folder = past(tmp_path / "run", search_time_s={"1": 100.0, "2": None, "all": None})
    faulty = load("three_cells", {"robots": 3, "fault": [KILL], "duration_s": 99.0})
    baseline = Baseline.of(folder, faulty)
    assert baseline.lost_s({"1": 130.5, "2": 80.0, "all": None}) == {"1": 30.5, "2": None, "all": None}


@pytest.mark.parametrize("other", [{"seed": 2}, {"robots": 4}, {"radius_m": 9.0}])
def test_only_the_same_mission_is_compared(tmp_path: Path, other: dict[str, Any]) -> None:
    folder = past(tmp_path / "run", search_time_s={})
    with pytest.raises(ScenarioError, match=next(iter(other))):
        Baseline.of(folder, load("three_cells", {"robots": 3, **other}))


def orphan(robot: int, before: int, made: int, incarnation: int = 0) -> dict[str, Any]:
    return {
        "robot": robot, "incarnation": incarnation, "reports_before": before, "reports_made": made,
        "reports_discarded": 1,
    }  # fmt: skip


def test_the_age_of_what_robots_saw_is_reckoned_over_all_their_reports() -> None:
    scans = {"1/0": [0, 5, 10, 10], "2/0": [100]}
    merged = {"1/0": [(1, 2), (2, 6), (4, 40)], "2/0": [(1, 103)], "3/0": [(1, 9)], "2/1": []}
    # Ages in ticks: 1, 2, 3, 30, and that of the third report, which never came.
    assert information_age(scans, merged) == {"median_s": 0.3, "p95_s": None}
    merged["1/0"].append((3, 50))
    assert information_age(scans, merged) == {"median_s": 0.3, "p95_s": 4.0}
    assert information_age({}, {"3/0": [(1, 9)]}) == {"median_s": None, "p95_s": None}
    many = {"1/0": [0] * 100}
    assert information_age(many, {"1/0": [(n, n) for n in range(1, 96)]})["p95_s"] == 9.5
    assert information_age(many, {"1/0": [(n, n) for n in range(1, 95)]})["p95_s"] is None


def test_the_fate_of_every_report_is_told() -> None:
    verdict = {"orphans": [orphan(1, 10, 5), orphan(2, 3, 4), orphan(3, 0, 6, incarnation=1)]}
    acknowledged = {"1": [0, 15], "2": [0, 4], "3": [2, 0]}
    complete = {"1/0": 13, "2/0": 5, "3/1": 2}
    (settled,) = settle([verdict], acknowledged, complete)
    # Robot 1 believes that 14 and 15 are there: lost. Robot 2 still holds 6 and 7. Robot 3 died with 3 to 6.
    assert settled["scan_reports"] == {"delayed": 3 + 2 + 2, "pending": 2, "dead": 4, "lost": 2, "discarded": 3}
    assert lost_reports(acknowledged, {"complete": complete, "contradicted": 3}) == 2 + 3
    assert set(settle([verdict], acknowledged, None)[0]["scan_reports"].values()) == {None}
