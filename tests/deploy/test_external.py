"""External robots: how a scenario names them, and what is refused in one line before anything starts."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from deploy.scenario import ScenarioError, load
from deploy.simulation import Simulation
from deploy.sweep.plan import load_study, points_of
from tests.helpers.studies import tiny
from world.control import Control
from world.pace import Pace


def test_a_scenario_names_them_and_so_does_the_command_line(tmp_path: Path) -> None:
    own = load("three_cells", {"robots": 4, "robot": [{"id": 2, "external": True}, {"id": 3}]})
    assert own.external == (2,)
    both = load("three_cells", {"robots": 4, "robot": [{"id": 2, "external": True}, {"id": 3}], "external": [4, 3]})
    assert both.external == (2, 3, 4)
    path = tmp_path / "again.toml"
    path.write_text(both.to_toml())
    again = load(path)
    assert again.tables == dataclasses.replace(both.tables, name=again.name)
    assert again.world_config().external == (2, 3, 4)
    assert "robot =" not in load("three_cells").to_toml()
    assert "[[robot]]" not in load("three_cells").to_toml()


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"external": [5]}, "robot 5: there are only robots 1 to 4"),
        ({"external": [0]}, "robot 0: there are only robots 1 to 4"),
        ({"external": 3}, "expected a list of ids"),
        ({"robot": [{"id": 3}, {"id": 3}]}, "a robot has two tables"),
        ({"robot": [{"id": 3, "extern": True}]}, "unknown key 'extern' in \\[robot"),
        ({"robot": [{"external": True}]}, "robot\\[1\\].id is missing"),
        ({"external": [3], "fault": ["kill:3@5"]}, "fault\\[1\\]: kill of robot 3: it is external"),
        ({"external": [3], "fault": ["pause:3@5+1"]}, "fault\\[1\\]: pause of robot 3: it is external"),
        ({"external": [3], "fault": ["jam:3,4@5+1", "restart:3@5+1"]}, "fault\\[2\\]: restart of robot 3"),
    ],
)
def test_what_can_not_be_is_one_line(given: dict[str, object], line: str) -> None:
    with pytest.raises(ScenarioError, match=line) as refused:
        load("three_cells", {"robots": 4, **given})
    assert "\n" not in str(refused.value)


def test_no_fault_by_hand_stops_one() -> None:
    control = Control(Pace(0.0, lambda: 0.0), 4, dict, external=(3,))
    assert "robot 3: it is external" in json.loads(control.answer("fault kill:3@0"))["error"]
    assert "error" not in json.loads(control.answer("fault kill:2@0"))
    assert len(control.take()) == 1


def test_they_are_never_in_one_process(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="robot 3 is external"):
        Simulation(load("three_cells", {"robots": 4, "external": [3]}))
    study = tiny(tmp_path, 1, 5.0)
    study.write_text(study.read_text() + "\n[[variant]]\nname = 'one'\nset.external = [1]\n")
    with pytest.raises(ScenarioError, match="robot 1 is external"):
        points_of(load_study(str(study)))
