"""What no fleet can beat: on corridors that can be reckoned by hand, and on the floor plans that ship."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from deploy.scenario import Scenario, load
from deploy.sweep.lower_bound import LowerBound, least_radius_m, lower_bound
from tests import ROOT

PLANS = ("hospital_ward", "warehouse", "office_20_rooms", "tunnels", "cluttered_room")


def corridor(folder: Path, free: list[list[float]], **overrides: Any) -> LowerBound:
    """The bound of corridors 2 m wide, with the MS at (3, 3)."""
    return lower_bound(scenario(folder, free, **overrides))


def scenario(folder: Path, free: list[list[float]], **overrides: Any) -> Scenario:
    path = folder / "corridor.toml"
    plan = {"size_m": [80.0, 80.0], "free": free}
    station = {"position_m": [3.0, 3.0], "safety_zone_m": [2.0, 2.0, 4.0, 4.0]}
    path.write_text(tomli_w.dumps({"name": "corridor", "floor_plan": plan, "station": station}))
    return load(path, {"radius_m": 15.0, "lidar.range_m": 8.0, "robots": 6, **overrides})


def test_a_straight_chain_ends_where_its_lidar_reaches(tmp_path: Path) -> None:
    # The end is 65 m away: four links of 15 m and 8 m of sight cover 68 m, three only 53 m. To stand there takes five.
    bound = corridor(tmp_path, [[2, 2, 68, 4]])
    assert (bound.chain, bound.hops, bound.within, bound.feasible) == (4, 5, 1.0, True)
    too_few = corridor(tmp_path, [[2, 2, 68, 4]], robots=3)
    assert too_few.chain == 4
    assert not too_few.feasible
    assert too_few.within == pytest.approx((3 + 45 + 8 - 2) / 66, abs=0.03)


def test_a_bend_costs_a_robot_only_where_walls_count(tmp_path: Path) -> None:
    # Two legs of 12 m: around the corner as the crow flies 14.1 m at most, but out of sight.
    bend = [[2, 2, 15, 4], [13, 2, 15, 15]]
    chains = {}
    for model in ("disk", "log_distance", "disk_los"):
        bound = corridor(tmp_path, bend, **{"radio.model": model, "lidar.range_m": 4.0})
        chains[model] = bound.chain
    assert chains == {"disk": 1, "log_distance": 2, "disk_los": 2}
    thin = corridor(tmp_path, bend, **{"radio.model": "log_distance", "radio.wall_loss_db": 0.1, "lidar.range_m": 4.0})
    assert thin.chain == 1


def test_a_radio_that_reaches_no_place_makes_no_chain(tmp_path: Path) -> None:
    bound = corridor(tmp_path, [[2, 2, 68, 4]], radius_m=0.5)
    assert bound.chain is None
    assert not bound.feasible


def test_r_low_is_the_least_radius_with_which_the_chain_sees_every_place(tmp_path: Path) -> None:
    """The end of a straight corridor is 65 m away, and a lidar sees 8 m: 57 m in N links, of whole metres."""
    plan = scenario(tmp_path, [[2, 2, 68, 4]])
    assert [least_radius_m(plan, robots) for robots in (3, 4, 6)] == pytest.approx([19.0, 14.5, 10.0], abs=0.5)
    for radius_m, feasible in ((0.98, False), (1.0, True)):
        bound = corridor(tmp_path, [[2, 2, 68, 4]], robots=4, radius_m=radius_m * least_radius_m(plan, 4))
        assert (bound.within == 1.0) == feasible


def test_r_low_is_smaller_where_the_radio_passes_walls(tmp_path: Path) -> None:
    """Two corridors side by side: 6 m through the wall, 60 m on foot."""
    folded = [[2, 2, 32, 4], [30, 2, 32, 10], [2, 8, 32, 10]]
    radii = {
        model: least_radius_m(scenario(tmp_path, folded, **{"radio.model": model, "lidar.range_m": 4.0}), 3)
        for model in ("disk", "log_distance", "disk_los")
    }
    assert radii["disk"] < 12.0 < radii["log_distance"] <= radii["disk_los"]
    shut = [[2, 2, 32, 4], [40, 8, 50, 10]]
    assert least_radius_m(scenario(tmp_path, shut, **{"lidar.range_m": 4.0}), 0) == math.inf


def test_nobody_is_faster_than_the_walk_and_the_sweep(tmp_path: Path) -> None:
    top_m_s = 2.0 / 3.6
    bound = corridor(tmp_path, [[2, 2, 68, 4]])
    # The end comes in sight 8 m before it; robots start up to 3 m ahead, places are a metre apart.
    walk_s = (65.0 - 8.0 - 3.0) / top_m_s
    assert walk_s / 1.0824 - 4.0 < bound.walk_s <= walk_s
    assert bound.sweep_s == 0.0
    hall = corridor(tmp_path, [[1, 1, 79, 79]], robots=2, radius_m=50.0)
    seen_at_first = math.pi * min(2 * 8.0**2, 11.0**2)
    assert hall.sweep_s == pytest.approx((78 * 78 - 4 - seen_at_first) / (2 * 16.0 * top_m_s), rel=1e-6)
    assert hall.t_low_s == hall.sweep_s > hall.walk_s
    assert hall.feasible
    assert not corridor(tmp_path, [[1, 1, 79, 79]], robots=2, radius_m=50.0, duration_s=hall.t_low_s - 1.0).feasible


@pytest.mark.parametrize("name", PLANS)
def test_a_plan_that_ships_needs_five_hops_and_is_feasible(name: str) -> None:
    page = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| `{name}` \|.*\| ([\d,]+) m2 \| (\d+) \| (\d+) \| (\d+) s \|$", page, re.MULTILINE)
    assert row is not None, f"docs/scenarios.md has no row of {name}"
    floor_m2, chain_blocked, chain_18_db, t_low_s = (int(value.replace(",", "")) for value in row.groups())
    for model, chain in (("disk_los", chain_blocked), ("log_distance", chain_18_db)):
        bound = lower_bound(load(name, {"robots": 12, "radius_m": 15.0, "radio.model": model}))
        assert bound.chain == chain >= 5
        assert bound.hops >= 5
        assert bound.feasible
        assert round(bound.t_low_s) == t_low_s
        assert round(bound.area_m2) == floor_m2
        assert 400 <= bound.area_m2 <= 2000
