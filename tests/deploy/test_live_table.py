"""What a person sees of a run."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from deploy.screen.live_table import LiveTable
from deploy.screen.plain_lines import PlainLines
from world.feed import Event, Snapshot
from world.terms import NOBODY, UNREACHABLE, Cls, Mode

HERE = {"robot/1": 101, "robot/2": 102, "robot/3": 103}

AT_1_S = Snapshot(
    tick=10,
    nodes=np.array([1, 2, 3], np.int16),
    present=np.ones(3, np.uint8),
    xy_m=np.zeros((3, 2)),
    cls=np.array([Cls.RR, Cls.SR, Cls.SR], np.uint8),
    mode=np.array([Mode.WALK, Mode.WALK, Mode.LOST], np.uint8),
    hops=np.array([1, 2, UNREACHABLE], np.uint8),
    nms=np.array([0, 1, NOBODY], np.int16),
    msr=np.array([2, NOBODY, NOBODY], np.int16),
    target_m=np.zeros((3, 2)),
    search_rate=(1.0, 0.25),
    merged=17,
)


def console(*, terminal: bool) -> tuple[Console, io.StringIO]:
    shown = io.StringIO()
    return Console(file=shown, force_terminal=terminal, width=100, color_system=None), shown


@pytest.mark.parametrize(("verb", "word"), [("pause", "paused"), ("kill", "dead"), ("restart", "dead")])
def test_who_takes_no_part_is_called_paused_or_dead(verb: str, word: str) -> None:
    terminal, shown = console(terminal=True)
    table = LiveTable(terminal, ("north", "south"))
    table.event(Event(9, "fault", 2, f"{verb}:2", {"verb": verb}))
    table.snapshot(replace(AT_1_S, present=np.array([1, 0, 1], np.uint8)))
    table.close()
    assert any(" ".join(line.split()) == f"2 SR 2 1 - {word}" for line in shown.getvalue().splitlines())


def test_who_is_on_a_sortie_is_called_away() -> None:
    terminal, shown = console(terminal=True)
    table = LiveTable(terminal, ("north", "south"))
    table.snapshot(replace(AT_1_S, mode=np.array([Mode.WALK, Mode.WALK, Mode.AWAY], np.uint8)))
    table.close()
    lines = [" ".join(line.split()) for line in shown.getvalue().splitlines()]
    assert any(line.endswith("3 SR - - - away") for line in lines)
    assert not any(line.endswith("lost") for line in lines)


def test_the_table_shows_each_robot_and_each_cell() -> None:
    terminal, shown = console(terminal=True)
    table = LiveTable(terminal, ("north", "south"))
    table.processes(HERE)
    table.snapshot(AT_1_S)
    table.event(Event(10, "fault", 3, "robot 3 is killed"))
    table.close()
    lines = [" ".join(line.split()) for line in shown.getvalue().splitlines()]
    assert any(line.endswith("1 101 RR 1 MS 2 relay") for line in lines)
    assert any(line.endswith("2 102 SR 2 1 - search") for line in lines)
    assert any(line.endswith("3 103 SR - - - lost") for line in lines)
    assert any("south" in line and "25%" in line for line in lines)
    assert any("1.0 s fault: robot 3 is killed" in line for line in lines)


def test_the_table_of_a_hundred_robots_is_cut_off() -> None:
    terminal, shown = console(terminal=True)
    n = 100
    zeros = np.zeros(n, np.uint8)
    many = replace(
        AT_1_S, nodes=np.arange(1, n + 1, dtype=np.int16), present=zeros, cls=zeros, mode=zeros, hops=zeros,
        nms=np.zeros(n, np.int16), msr=np.zeros(n, np.int16),
    )  # fmt: skip
    table = LiveTable(terminal, ("north", "south"), tallest=20)
    table.snapshot(many)
    table.close()
    assert "80 more" in shown.getvalue()


def test_plain_lines_name_new_pids_and_tenths_of_progress_once() -> None:
    plain, shown = console(terminal=False)
    lines = PlainLines(plain)
    lines.processes(HERE)
    lines.processes({"robot/1": 101, "robot/2": 102})
    lines.processes({"robot/1": 101, "robot/2": 102, "robot/3": 203})
    for tick in (10, 11, 12):
        lines.snapshot(replace(AT_1_S, tick=tick))
    lines.event(Event(12, "role", 1, "robot 1 is now SR"))
    out = shown.getvalue().splitlines()
    assert out[0] == "pids: robot/1 101, robot/2 102, robot/3 103"
    assert out[1] == "pids: robot/3 203"
    assert len(out) == 3
    assert "100% 25%" in out[2]


def test_the_first_routes_are_no_news_and_a_lost_one_is() -> None:
    for terminal in (True, False):
        where, shown = console(terminal=terminal)
        view = LiveTable(where, ("north", "south")) if terminal else PlainLines(where)
        view.event(Event(1, "link", 1, "robot 1 has a route to the MS"))
        view.event(Event(300, "link", 1, "robot 1 lost its route to the MS"))
        assert shown.getvalue() == "    30.0 s  link: robot 1 lost its route to the MS\n"
        view.close()
