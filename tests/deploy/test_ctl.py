"""The command `ctl`: what it asks of a run, whom it asks, and what it says in a line."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from deploy.ctl import VERBS, main, question, runs_under_way, show


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ("kill 4", "fault kill:4@0"),
        ("pause 4 5", "fault pause:4@0+5"),
        ("restart relay:mid 5", "fault restart:relay:mid@0+5"),
        ("jam 1,2 5", "fault jam:1,2@0+5"),
        ("loss 0.3 10", "fault loss:0.3@0+10"),
        ("speed 5", "speed 5"),
        ("status", "status"),
    ],
)
def test_commands_by_hand_become_what_the_world_understands(words: str, asked: str) -> None:
    assert question(words.split()) == asked


ACTED = {"at_s": 88.4, "node": 4, "text": "kill:relay:mid@88.4 (robot 4)", "done": True}
NOBODY = {"at_s": 3.0, "node": -1, "text": "kill:relay:mid@3: nobody is relay:mid, nothing done", "done": False}
PACE = {"tick": 884, "held": False, "speed": "max", "interrupted": False}


@pytest.mark.parametrize(
    ("words", "told", "line"),
    [
        ("kill relay:mid", {"tick": 883, "acted": ACTED}, "88.4 s: killed robot 4 (relay:mid), run NAME"),
        ("kill 4", {"tick": 883, "acted": ACTED}, "88.4 s: killed robot 4, run NAME"),
        ("pause sr:far 5", {"tick": 883, "acted": ACTED}, "88.4 s: paused robot 4 (sr:far) for 5 s, run NAME"),
        ("kill relay:mid", {"tick": 30, "acted": NOBODY}, f"3.0 s: {NOBODY['text']}, run NAME"),
        ("kill 4", {"tick": 884, "fault": "kill:4@0"}, "88.4 s: kill 4 acts at the next tick, run NAME"),
        ("hold", PACE | {"held": True}, "88.4 s: held, run NAME"),
        ("step", PACE | {"held": True}, "88.4 s: 1 tick(s), then held, run NAME"),
        ("go", PACE, "88.4 s: goes on as fast as it can, run NAME"),
        ("speed 10", PACE | {"speed": 10.0}, "88.4 s: goes on at 10.0 simulated seconds a second, run NAME"),
        ("interrupt", PACE | {"interrupted": True}, "88.4 s: ends, run NAME"),
    ],
)
def test_an_answer_is_a_line(words: str, told: dict[str, Any], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert show(json.dumps(told), words.split(), "NAME", whole=False) == (1 if "nothing done" in line else 0)
    assert capsys.readouterr().out == line + "\n"
    show(json.dumps(told), words.split(), "NAME", whole=True)
    assert json.loads(capsys.readouterr().out) == told


def test_the_status_is_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    told = PACE | {"robots": [1, 3], "search_rate": [0.5, 0.25], "waiting_for": []}
    assert show(json.dumps(told), ["status"], "NAME", whole=False) == 0
    rows = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert ["robots", "1, 3"] in rows
    assert ["searched", "50% 25%"] in rows
    assert ["simulated", "88.4 s"] in rows


def test_without_a_command_it_lists_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert VERBS in capsys.readouterr().err


def test_where_two_runs_are_under_way_one_must_be_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for at_s, name in enumerate(("one", "two", "over")):
        (tmp_path / "runs" / name).mkdir(parents=True)
        file = tmp_path / "runs" / name / "operator.json"
        file.write_text(json.dumps({"launcher": 2**31 - 1 if name == "over" else os.getpid()}))
        os.utime(file, (at_s, at_s))
    both = [Path("runs"), tmp_path / "runs"]
    assert [folder.name for folder in runs_under_way(both)] == ["two", "one"]
    assert main(["kill", "4"]) == 2
    refusal = capsys.readouterr().err
    assert "runs are under way: name one by --run: " in refusal
    assert "runs/two, " in refusal
    assert refusal.count("\n") == 1
