"""A whole small mission: its recording, and one digest at any speed and with any hash seed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from deploy.scenario import Scenario, load
from deploy.simulation import Observer, Result, Simulation
from monitor_station.recording.recorder import Recorder
from monitor_station.recording.tiles import MapTiles
from tests import ROOT
from tests.monitor_station.test_recorder import read
from world.terms import STATION

CORRIDOR = ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml"


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scenario, Result, Path]:
    """The corridor's cell, searched to its end, with a recording."""
    scenario = load(CORRIDOR, {"duration_s": 400.0, "radius_m": 14.0})
    path = tmp_path_factory.mktemp("mission") / "recording.rrd"
    recorder = Recorder(scenario.recorder_config("mission"), path)
    watch = Observer(recorder.snapshot, recorder.event, recorder.station, recorder.table)
    result = Simulation(scenario, watch).run()
    recorder.close()
    return scenario, result, path


def test_all_is_searched_and_nothing_is_lost(mission: tuple[Scenario, Result, Path]) -> None:
    _, result, _ = mission
    world, station = result.finals["world"], result.finals["station"]
    assert world["status"] == "searched"
    assert station["search_rate"] == {"A": 1.0}
    reports = world["scan_reports"]
    assert reports["discarded"] == 0
    assert station["merged"] + reports["buffered"] >= reports["made"]
    assert station["victims_found"]


def test_the_recorded_map_is_the_floor_plan_wherever_a_cell_was_searched(
    mission: tuple[Scenario, Result, Path],
) -> None:
    scenario, _, path = mission
    rows = read(path)
    geometry = scenario.arena.geometry
    seen = np.full((geometry.rows, geometry.cols), 255, np.uint8)
    for tile in MapTiles(geometry).tiles:
        pixels = rows[f"/ms/map/{tile.name}", "GridMap:data"]
        if pixels:
            part = np.array(pixels[-1][1][0], np.uint8).reshape(tile.rows, tile.cols)[::-1]
            seen[tile.row : tile.row + tile.rows, tile.col : tile.col + tile.cols] = part
    free, wall = seen == 0, seen == 100
    assert not (free & scenario.arena.occupied).any()
    assert not (wall & ~scenario.arena.occupied).any()
    for cell in scenario.arena.search_cells:
        assert free.ravel()[cell.cells].all()


def test_the_recorded_chain_follows_the_robots_own_pointers(mission: tuple[Scenario, Result, Path]) -> None:
    _, result, path = mission
    chains = read(path)["/network/chain", "nodes"]
    at = 0
    longest = 0
    for snapshot in result.snapshots:
        while at + 1 < len(chains) and chains[at + 1][0] <= snapshot.tick:
            at += 1
        nodes = chains[at][1]
        assert all(snapshot.nms[a - 1] == b for a, b in pairwise(nodes))
        assert not nodes or nodes[-1] == STATION
        longest = max(longest, len(nodes))
    assert longest >= 4


@pytest.mark.processes
def test_one_digest_whatever_the_speed_and_the_hash_seed(tmp_path: Path) -> None:
    def digest(name: str, hash_seed: str, *options: str) -> str:
        out = tmp_path / name
        command = [
            sys.executable,
            str(ROOT / "deploy/run_local.py"),
            "--scenario",
            str(CORRIDOR),
            "--no-recording",
            "-q",
        ]
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        subprocess.run([*command, "--out", str(out), *options], check=True, env=environment)
        summary = json.loads((out / "summary.json").read_text())
        assert summary["wall_clock_faults"] == 0
        return str(summary["trace_sha256"])

    expected = digest("alone", "1", "--in-process")
    assert digest("alone again", "2", "--in-process") == expected
    assert digest("as fast as possible", "1") == expected
    assert digest("at a given speed", "2", "--speed", "20") == expected
