"""Where the station, the robots and the search cells are, and what can't be reached."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from deploy.scenario import ScenarioError, load


def two_rooms(folder: Path, *more: str) -> Path:
    """A closed booth of 4 x 4 m in the middle of a floor of 30 x 20 m with 2 m of wall around it."""
    path = folder / "two.toml"
    walls = [[11, 6, 19, 8], [11, 12, 19, 14], [11, 6, 13, 14], [17, 6, 19, 14]]
    plan = f"size_m = [30, 20]\nfree = [[0, 0, 30, 20]]\nwalls = {walls}"
    path.write_text("\n".join(['name = "two"', "[floor_plan]", plan, *more, ""]))
    return path


def test_a_station_that_nobody_placed_stands_in_the_largest_part_clear_of_walls(tmp_path: Path) -> None:
    scenario = load(two_rooms(tmp_path))
    x, y = scenario.arena.station_m
    assert math.dist((x, y), (15, 10)) < 5.5
    square = scenario.arena.geometry.rectangle(x - 0.8, y - 0.8, x + 0.8, y + 0.8)
    assert len(square) == 9
    assert not scenario.arena.occupied.ravel()[square].any()
    assert len(scenario.arena.search_cells[0].cells) == (600 - 64) * 4
    assert scenario.arena.unreachable == pytest.approx(16 / (600 - 64 + 16))
    assert scenario.remark == "2.9% of the free floor can't be reached from the station"


def test_a_cell_that_lies_in_two_parts_says_so(tmp_path: Path) -> None:
    cells = (
        '[[cell]]\nname = "west"\nrectangle_m = [0, 0, 10, 20]\n[[cell]]\nname = "mid"\nrectangle_m = [12, 0, 18, 20]'
    )
    scenario = load(two_rooms(tmp_path, cells))
    assert scenario.arena.unreachable_of == (0.0, pytest.approx(16 / 88))
    assert scenario.remark == ("2.9% of the free floor, 18.2% of cell 'mid' can't be reached from the station")
    assert load(two_rooms(tmp_path), {"station.position_m": [15.0, 10.0]}).remark.startswith("97.1% of the free floor")
    assert load("three_cells").remark == ""


def test_the_middle_of_a_narrow_floor_will_do(tmp_path: Path) -> None:
    path = tmp_path / "corridor.toml"
    path.write_text(
        'name = "c"\nrobots = 1\n[floor_plan]\nsize_m = [30, 3]\nfree = [[1, 1, 29, 2]]\nresolution_m = 0.5\n'
    )
    x, y = load(path).arena.station_m
    assert (abs(x - 15.0), abs(y - 1.5)) == (0.25, 0.25)


def test_no_room_for_the_robots_is_said(tmp_path: Path) -> None:
    path = tmp_path / "closet.toml"
    plan = {"size_m": [5.0, 5.0], "free": [[2.0, 2.0, 2.5, 2.5]]}
    path.write_text(tomli_w.dumps({"name": "closet", "floor_plan": plan, "victims": {"per_cell": 0}}))
    with pytest.raises(ScenarioError, match="no free place for robot 1 of 9"):
        load(path)


def test_the_barrier_closes_the_way_to_cell_3() -> None:
    for arena, cell_3 in [("three_cells", [33, 52, 50, 67.5]), ("three_cells_wide", [37, 60, 57, 78])]:
        closed = load(f"{arena}_barrier")
        assert closed.cell_names == ("1", "2")
        free = np.count_nonzero(~load(arena).arena.occupied) - np.count_nonzero(~closed.arena.occupied)
        assert free == 2 * 6, "1 x 3 m of barrier"
        with pytest.raises(ScenarioError, match=r"cell '3'.*reached"):
            load(f"{arena}_barrier", {"cell": [{"name": "3", "rectangle_m": cell_3}]})
