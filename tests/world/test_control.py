"""What an operator says: commands of pace are obeyed, faults wait until the world takes them."""

from __future__ import annotations

import json

import pytest

from world.config import Fault
from world.control import Control
from world.pace import Pace


@pytest.fixture
def control() -> Control:
    return Control(Pace(0.0, lambda: 0.0), 4, lambda: {"tick": 7})


def test_a_fault_waits_until_it_is_taken_and_is_taken_once(control: Control) -> None:
    assert json.loads(control.answer("fault kill:3@60")) == {"tick": 7, "fault": "kill:3@60"}
    control.answer("fault pause:2@1+5")
    assert control.take() == [Fault("kill", 60.0, "3"), Fault("pause", 1.0, "2", 5.0)]
    assert control.take() == []


@pytest.mark.parametrize("line", ["fault kill:5@60", "fault kill:3", "fault", "jump"])
def test_what_is_wrong_is_one_clear_line_and_nothing_acts(control: Control, line: str) -> None:
    answer = json.loads(control.answer(line))
    assert list(answer) == ["error"]
    assert "\n" not in answer["error"]
    assert control.take() == []


def test_pace_is_part_of_every_answer_to_its_commands(control: Control) -> None:
    assert json.loads(control.answer("hold")) == {"tick": 7, "held": True, "speed": "max", "interrupted": False}
