"""Time by phase: counted between marks, skipped before a tick, the same after the wire, and shown."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from bus.codec import WireError, pack
from bus.phases import Phases, decode_phases
from deploy.run_folder.writer import RunFolder
from deploy.scenario import ScenarioError, load
from deploy.screen.live_table import LiveTable
from tests.bench.mission import Degree
from tests.helpers.synthetic import Mission


class Clock:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_a_mark_counts_since_the_mark_before() -> None:
    clock = Clock()
    phases = Phases(clock)
    for phase, seconds in (("waiting", 3.0), ("decode", 0.5), ("waiting", 1.0)):
        clock.now_s += seconds
        phases.mark(phase)
    clock.now_s += 7.0
    phases.skip()
    phases.mark("encode")
    assert phases.spent_s == {"waiting": 4.0, "decode": 0.5, "encode": 0.0}
    assert decode_phases(phases.encode()) == phases.spent_s


@pytest.mark.parametrize("data", [b"\xc1", pack((1,)), b"\x81\xa1a\x01", b"\x81\x01\xcb" + bytes(8)])
def test_malformed_phases_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode_phases(data)


def test_summary_has_milliseconds_per_tick(tmp_path: Path) -> None:
    finals = {"world": {"ticks": 200}, "phases": {"robot-1": {"waiting": 1.0, "decode": 0.02}}}
    with RunFolder(tmp_path, load("three_cells")) as folder:
        summary = folder.finish(finals, 1.0)
    assert summary["tick_phases"] == {"robot-1": {"waiting": 5.0, "decode": 0.1}}


def test_live_table_shows_the_dearest_phase_first_and_waiting_last() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    table = LiveTable(console, ("1",))
    spent = {"waiting": 8.0, "decode": 0.5, "planning": 1.5}
    table.phases({"robot-1": spent, "robot-2": spent, "world": {"step": 1.0}})
    table.snapshot(next(iter(Mission(2).moments(1))).snapshot)
    table.close()
    assert isinstance(console.file, io.StringIO)
    assert "robot   planning 15%  decode 5%  waiting 80%" in console.file.getvalue()


def test_robots_may_start_spread() -> None:
    scenario = load("hundred")
    assert len({tuple(place) for place in scenario.arena.starts_m.tolist()}) == 100
    degree = Degree(scenario.radius_m)
    degree.add(next(iter(Mission(2).moments(1))).snapshot)
    assert degree.mean == 1.0
    with pytest.raises(ScenarioError, match="start_radius_m"):
        load("hundred", {"station.start_radius_m": 1.0})
