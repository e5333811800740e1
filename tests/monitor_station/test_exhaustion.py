"""A search without a frontier to which a path leads ends, says why, and fails unless it is finished."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.run_folder.summary import remainder, shortfall
from deploy.scenario import load
from deploy.simulation import Simulation
from monitor_station.exhaustion import Exhaustion
from tests import ROOT
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

GEOMETRY = GridGeometry(12, 12, 1.0)


def closed_room() -> np.ndarray:
    """A room of 4 m around the MS, all of it known, in an unknown world."""
    states = np.full((12, 12), UNKNOWN, np.int8)
    states[1:7, 1:7] = OCCUPIED
    states[2:6, 2:6] = FREE
    return states


def first_exhausted(exhaustion: Exhaustion, states: np.ndarray, ticks: range) -> int | None:
    return next((tick for tick in ticks if exhaustion.step(tick, states.ravel())), None)


def test_a_closed_room_is_exhausted_after_half_a_minute() -> None:
    exhaustion = Exhaustion(GEOMETRY, (3.5, 3.5))
    assert first_exhausted(exhaustion, closed_room(), range(400)) == 300


def test_a_frontier_to_which_no_path_leads_does_not_count() -> None:
    states = closed_room()
    states[9, 9] = FREE
    exhaustion = Exhaustion(GEOMETRY, (3.5, 3.5))
    assert exhaustion.reachable(states.ravel())[0].size == 0
    assert first_exhausted(exhaustion, states, range(400)) == 300


def test_while_there_is_a_frontier_nothing_is_exhausted_and_a_new_one_starts_the_wait_anew() -> None:
    states = closed_room()
    states[6, 3] = FREE
    exhaustion = Exhaustion(GEOMETRY, (3.5, 3.5))
    assert exhaustion.reachable(states.ravel())[0].tolist() == [6 * 12 + 3]
    assert first_exhausted(exhaustion, states, range(2000)) is None
    states[6, 3] = OCCUPIED
    assert first_exhausted(exhaustion, states, range(2000, 2250)) is None
    states[6, 3] = FREE
    assert first_exhausted(exhaustion, states, range(2250, 4000)) is None
    states[6, 3] = OCCUPIED
    assert first_exhausted(exhaustion, states, range(4000, 5000)) == 4300


PLAN = """
name = "hidden"
robots = 2
radius_m = 20.0
duration_s = 120.0
[floor_plan]
size_m = [10.0, 6.0]
free = [[1.0, 1.0, 9.0, 5.0]]
[station]
position_m = [3.0, 3.0]
"""


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_a_mission_without_a_frontier_ends_and_says_what_is_left(tmp_path: Path, lost: float) -> None:
    """The MS is told that some free cells are walls, as by a robot that lies."""
    path = tmp_path / "hidden.toml"
    path.write_text(PLAN)
    simulation = Simulation(load(path, {}))
    simulation.step()
    assert simulation.station is not None
    merger = simulation.station.merger
    inside = np.flatnonzero(merger.cells == UNKNOWN)
    free = inside[~simulation._scenario.arena.occupied.ravel()[inside]]
    merger._hits[free[: max(1, round(lost * len(free)))]] += 1
    result = simulation.run()
    world, station = result.finals["world"], result.finals["station"]
    summary: dict[str, Any] = {"status": world["status"], "why": world["why"], "simulated_s": 1.0, **station}
    assert world["status"] == "exhausted"
    assert world["ticks"] < 600
    assert station["left"]["called_wall"] > 0
    assert station["left"]["frontiers"] == 0
    assert f"the map shows {station['left']['called_wall']} of the other cells as wall" in remainder(summary)
    words = shortfall(summary)
    assert (words is None) == (station["known_free"]["share"] >= 0.995)
    if words is not None:
        assert "no frontier to which a path leads" in words


def test_a_finished_search_is_no_failure() -> None:
    summary: dict[str, Any] = {
        "status": "exhausted", "why": "the map has no frontier to which a path leads", "simulated_s": 9.0,
        "known_free": {"share": 0.996}, "left": {"called_wall": 3, "unknown": 1, "frontiers": 0},
    }  # fmt: skip
    assert shortfall(summary) is None
    assert remainder(summary) == (
        "99.60% of what can be searched is known to be free; the map shows 3 of the other cells as wall and 1 as "
        "unknown, and no path leads to what is unknown"
    )
    summary["known_free"] = {"share": 0.9949}
    assert shortfall(summary) is not None


HOSPITAL = ROOT.parent / "shared" / "maps" / "hospital_025.yaml"


@pytest.mark.skipif(not HOSPITAL.exists(), reason="the map of the hospital is not beside this checkout (shared/maps)")
def test_noise_on_the_hospital_leaves_few_walls_in_the_way(tmp_path: Path) -> None:
    """A minute of twelve robots with 5 cm of noise in lidar and pose."""
    path = tmp_path / "hospital.toml"
    path.write_text(
        f'name = "hospital"\npolicy = "scout"\nrobots = 12\nradius_m = 15.0\nduration_s = 60.0\npose_noise_m = 0.05\n'
        f'[lidar]\nnoise_m = 0.05\n[floor_plan]\nmap = "{HOSPITAL}"\n[station]\nposition_m = [12.5, 47.5]\n'
    )
    station = Simulation(load(path, {})).run().finals["station"]
    assert station["known_free"]["share"] > 0.3
    assert station["map_errors"]["free_called_wall"] < 0.005
    assert station["map_errors"]["wall_called_free"] < 0.01
