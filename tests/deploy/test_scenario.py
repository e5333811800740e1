"""Scenarios: those of the emulator, the round trip through TOML, and one clear line for every mistake."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.scenario import Scenario, ScenarioError, load, names
from tests.helpers.map_files import room_map
from world.config import Fault
from world.grid import GridGeometry
from world.grid.lines import line_of_sight
from world.grid.map_file import save_map


def same(a: Scenario, b: Scenario) -> bool:
    return a.tables == b.tables and all(
        np.array_equal(x, y)
        for x, y in [
            (a.arena.occupied, b.arena.occupied),
            (a.arena.starts_m, b.arena.starts_m),
            (a.arena.victims_m, b.arena.victims_m),
        ]
    )


@pytest.mark.parametrize("name", [name for name in names() if name.startswith("three_cells")])
def test_every_arena_of_the_paper_loads_and_fits(name: str) -> None:
    scenario = load(name)
    world = scenario.world_config()
    assert scenario.name == name
    assert (world.robots, scenario.radius_m, world.duration_s, world.speed) == (9, 20.0, 4000.0, 0.0)
    assert len(world.victims_m) == 3 * len(scenario.arena.search_cells)
    away = np.hypot(*(world.starts_m - world.station_m).T)
    assert ((away >= 1.0) & (away <= 3.0)).all()
    for start in world.starts_m.tolist():
        assert line_of_sight(world.occupied, world.geometry, tuple(start), world.station_m)
    for x, y in world.victims_m:
        assert not world.occupied.ravel()[world.geometry.index(x, y)]


def test_three_cells_is_the_arena_of_the_procedure() -> None:
    scenario = load("three_cells")
    assert scenario.cell_names == ("1", "2", "3")
    assert [len(cell.cells) * 0.25 for cell in scenario.arena.search_cells] == [18 * 15.5, 18 * 15.5, 17 * 15.5]
    assert scenario.arena.geometry == GridGeometry(140, 108, 0.5)
    assert scenario.world_config().top_speed_m_s == pytest.approx(2 / 3.6)
    assert scenario.robot_config(4).safety_zone_m == (24.0, 29.0, 34.0, 41.0)
    assert scenario.station_config().node.node == 0


@pytest.mark.parametrize("name", names())
def test_round_trip_through_toml(name: str, tmp_path: Path) -> None:
    scenario = load(
        name,
        {
            "seed": 7,
            "speed": 20,
            "radio.model": "log_distance",
            "radio.shadowing_db": 4.0,
            "rules.routing.sticky": False,
            "change": [{"at_s": 9.5, "set": {"radio.loss": 0.25, "radio.fading": "rician"}}],
            "fault": ["kill:relay:mid@90", "pause:4@60+5", "jam:3,4@50+10", "jam:10,10,20,20@50+10", "loss:0.3@5+1"],
        },
    )
    path = tmp_path / "scenario.toml"
    path.write_text(scenario.to_toml())
    again = load(path)
    assert same(again, scenario)
    assert again.to_toml() == scenario.to_toml()


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 30),
    st.floats(0.5, 1000.0),
    st.integers(0, 2**63 - 1),
    st.sampled_from(["max", 0.5, 20.0]),
    st.lists(st.tuples(st.floats(0, 3999), st.floats(0.1, 1e4), st.integers(1, 9)), max_size=4),
)
def test_any_values_survive_toml(
    tmp_path_factory: pytest.TempPathFactory,
    robots: int,
    radius_m: float,
    seed: int,
    speed: Any,
    pauses: list[tuple[float, float, int]],
) -> None:
    faults = [Fault("pause", at_s, str(min(robot, robots)), for_s) for at_s, for_s, robot in pauses]
    given_values = {"robots": robots, "radius_m": radius_m, "seed": seed, "speed": speed, "fault": faults}
    scenario = load("three_cells", given_values)
    path = tmp_path_factory.mktemp("round") / "scenario.toml"
    path.write_text(scenario.to_toml())
    assert same(load(path), scenario)


def test_same_seed_same_places_other_seed_other_places() -> None:
    one, again, two = (load("three_cells", {"seed": seed}).arena for seed in (1, 1, 2))
    assert np.array_equal(one.starts_m, again.starts_m)
    assert np.array_equal(one.victims_m, again.victims_m)
    assert not np.array_equal(one.starts_m, two.starts_m)
    assert not np.array_equal(one.victims_m, two.victims_m)


def test_received_power_is_smoothed_only_where_it_is_noisy() -> None:
    def smoothing(**radio: Any) -> float:
        values = {f"radio.{key}": value for key, value in radio.items()}
        return load("three_cells", values).robot_config(1).power_smoothing_s

    assert smoothing() == 0.0
    assert smoothing(model="disk", shadowing_db=4.0) == 0.0
    assert smoothing(model="log_distance") == 0.0
    assert smoothing(model="log_distance", shadowing_db=4.0) == 1.0
    assert smoothing(model="log_distance", fading="rician") == 1.0


def test_a_ros_map_alone_is_a_scenario(tmp_path: Path) -> None:
    scenario = load(room_map(tmp_path))
    arena = scenario.arena
    assert scenario.name == "room"
    assert scenario.cell_names == ("all",)
    assert len(arena.search_cells[0].cells) == 16 * 20 - 8
    assert math.dist(arena.station_m, (1.0, 1.0)) <= 0.5
    zone = arena.geometry.rectangle(*arena.safety_zone_m)
    assert len(zone)
    assert not arena.occupied.ravel()[zone].any()
    assert arena.cell_rectangles_m == ((-4.0, -3.0, 6.0, 5.0),)
    stored = tmp_path / "elsewhere" / "scenario.toml"
    stored.parent.mkdir()
    stored.write_text(scenario.to_toml())
    assert np.array_equal(load(stored).arena.occupied, arena.occupied)


def test_a_map_is_resampled_to_the_resolution_that_a_scenario_names(tmp_path: Path) -> None:
    path = room_map(tmp_path)
    native, coarse = load(path), load(path, {"floor_plan.resolution_m": 1.0})
    assert native.arena.geometry.resolution_m == 0.5
    assert coarse.arena.geometry.resolution_m == 1.0
    assert coarse.arena.occupied.shape == (10, 12)
    stored = tmp_path / "scenario.toml"
    for scenario in (native, coarse):
        stored.write_text(scenario.to_toml())
        assert np.array_equal(load(stored).arena.occupied, scenario.arena.occupied)


def test_a_stored_scenario_refuses_a_changed_map(tmp_path: Path) -> None:
    path = room_map(tmp_path)
    stored = tmp_path / "scenario.toml"
    stored.write_text(load(path).to_toml())
    save_map(path, GridGeometry(20, 24, 0.5), np.zeros((20, 24), np.int8))
    with pytest.raises(ScenarioError, match="map_sha256"):
        load(stored)


def test_a_relative_map_is_relative_to_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room_map(tmp_path)
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[floor_plan]\nmap = "room.yaml"\n[station]\nposition_m = [1.0, 1.0]\n')
    monkeypatch.chdir("/")
    assert load(path).arena.station_m == (1.0, 1.0)


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"robots": 0}, "robots = 0"),
    ({"robots": -3}, "robots = -3"),
    ({"robots": 9.5}, "robots = 9.5"),
    ({"robots": True}, "robots = True"),
    ({"radius_m": float("nan")}, "radius_m = nan: should be a finite number"),
    ({"radius_m": float("inf")}, "radius_m = inf"),
    ({"radius_m": 0}, "radius_m = 0: should be greater than or equal to 0.01"),
    ({"seed": -1}, "seed"),
    ({"duration_s": 0}, "duration_s"),
    ({"speed": "fast"}, "speed = 'fast': should be 'max' or should be a valid number"),
    ({"speed": -1.0}, "speed"),
    ({"policy": "scuot"}, "policy = 'scuot'"),
    ({"raduis_m": 3}, "unknown key 'raduis_m', did you mean 'radius_m'"),
    ({"radio.los": 0.1}, r"unknown key 'los' in \[radio\], did you mean 'loss'"),
    ({"rules.routing.sticki": True}, "did you mean 'sticky'"),
    ({"radio.model": "disc"}, "radio.model = 'disc'"),
    ({"radio.loss": 1.5}, "radio.loss = 1.5"),
    ({"radio": 3}, "radio = 3: should be a table"),
    ({"radio.loss.more": 3}, r"radio.loss = \{'more': 3\}: should be a valid number"),
    ({"radio.fading": "rice"}, "radio.fading = 'rice'"),
    ({"radio.fading": "rician"}, 'radio.fading = "rician" needs model = "log_distance".*not "disk"'),
    ({"radio.coherence_s": 0.0}, "radio.coherence_s = 0"),
    ({"radio.shadowing_correlation_m": 0.0}, "radio.shadowing_correlation_m = 0"),
    ({"radio.burst_share": 1.0}, "radio.burst_share = 1"),
    ({"radio.burst_s": 0.05}, "radio.burst_s = 0.05"),
    ({"radio.burst_share": 0.9, "radio.burst_s": 0.5}, "radio.burst_s = 0.5: .*0.9.*needs burst_s >= 0.9"),
    ({"radio.channel_bytes_s": 0}, "radio.channel_bytes_s = 0"),
    ({"lidar.beams": 2}, "lidar.beams"),
    ({"rules.routing.r_in_share": 0.95}, "r_in_share < r_out_share"),
    ({"rules.exploring.retreat_min_s": 100.0}, "retreat_min_s <= retreat_max_s"),
    ({"lidar.range_m": 1e6}, "lidar.range_m = 1e.06: 2e.06 cells of 0.5 m; up to 1,000 are possible, here 500 m"),
    ({"radius_m": 10**5000}, "a whole number of thousands of digits"),
    ({"x" * 5000: 1}, "unknown key 'xxx.*xxx'"),
    ({"radio." + "x" * 5000: 1}, r"unknown key 'xxx.*xxx' in \[radio\]"),
    ({"radio" + ".loss" * 3000: 1}, "nested too deeply"),
    ({"robots." + "x" * 5000: 1}, "cannot set 'robots"),
    ({"name": ["x" * 5000]}, "name = "),
    ({"policy": "x" * 5000}, "policy = 'xxx"),
    ({"policy": "x" * 5000 + ":X"}, "cannot import"),
    ({"cell": [{"name": "x" * 5000, "rectangle_m": [4, 20, 9, 30]}]}, "at most 100 characters"),
    ({"floor_plan": {"map": "x" * 5000 + ".yaml"}}, "File name too long"),
    ({"floor_plan": {"map": "a\0b.yaml"}}, "null"),
    ({"station.position_m": [1.0, 1.0]}, "station.position_m = 1, 1 is inside a wall"),
    ({"station.position_m": [-100.0, 1.0]}, "inside a wall"),
    ({"station.position_m": [1e308, 1.0]}, r"station.position_m\[1\] = 1e.308: should be less than or equal to"),
    ({"station.position_m": [28.0]}, r"station.position_m\[2\] is missing"),
    ({"station.safety_zone_m": [0.0, 0.0, 3.0, 3.0]}, "does not hold the station"),
    ({"station.safety_zone_m": [20.0, 29.0, 34.0, 41.0]}, "holds a wall"),
    ({"cell": [{"name": "a", "rectangle_m": [0, 0, 1, 1]}]}, "cell 'a'.*no free place that can be reached"),
    ({"cell": [{"name": "a", "rectangle_m": [4, 20, 9, 30]}] * 2}, "cell name 'a' is taken"),
    ({"radius_m": 1e-300}, "radius_m = 1e-300: should be greater than or equal to 0.01"),
    *(
        ({f"deadlines.{key}_s": 1e-9}, f"deadlines.{key}_s = 1e-09: should be")
        for key in ("hang", "think", "medium", "return")
    ),
    ({"cell": [{"name": "time_s", "rectangle_m": [4, 20, 9, 30]}]}, "cell name 'time_s' is taken"),
    *(
        (
            {"cell": [{"name": name, "rectangle_m": [4, 20, 9, 30]}]},
            "cell name '.*' has control characters or line breaks",
        )
        for name in ("a\u2028b", "a\x85b", "a\nb", "a\rb", "\x1b[2J")
    ),
    ({"cell": [{"name": "a"}]}, r"cell\[1\].rectangle_m is missing"),
    ({"cell.name": "a"}, "'cell' is no table of single keys"),
    ({"victims.per_cell": 100_000}, "victims.per_cell = 100000"),
    ({"victims.positions_m": [[1.0, 1.0]]}, r"victims.positions_m\[1\]"),
    ({"floor_plan.map": "x.yaml"}, "either"),
    ({"floor_plan": {}}, "needs either map"),
    ({"floor_plan": {"map": "none.yaml"}}, "none.yaml: No such file"),
    ({"floor_plan.free": [[5.0, 5.0, 1.0, 9.0]]}, r"free\[1\].*x0 < x1"),
    ({"fault": ["kill:12@5"]}, r"fault\[1\]: target '12': there are only robots 1 to 9"),
    ({"fault": ["kill:nms-of:12@5"]}, "only robots 1 to 9"),
    ({"fault": ["jam:3,12@5+1"]}, "only nodes 0"),
    ({"fault": ["kill:4@5000"]}, "not within the run's duration_s = 4000"),
    ({"fault": ["kill:4@5+3"]}, "kill is for good"),
    ({"fault": ["restart:4@5"]}, "needs a duration"),
    ({"change": [{"at_s": 5.0, "set": {"policy": "scout"}}]}, r"change\[1\]: 'policy' can't change during a run: only"),
    (
        {"change": [{"at_s": 5.0, "set": {"radio.los": 1}}]},
        r"change\[1\]: unknown key 'los' in \[radio\], did you mean",
    ),
    ({"change": [{"at_s": 5.0, "set": {"radio.loss": 2}}]}, r"change\[1\]: radio.loss = 2: should be less"),
    (
        {"change": [{"at_s": 5.0, "set": {"radio.fading": "rician"}}]},
        r'change\[1\]: radio.fading = "rician" needs model',
    ),
    ({"change": [{"at_s": 5.0, "set": {"radio.channel_bytes_s": 9e3}}]}, r"change\[1\]: robots know from the start"),
    ({"change": [{"at_s": 5e3, "set": {"radio.loss": 0.1}}]}, "at_s = 5000 is not within the run's duration_s = 4000"),
    ({"change": [{"at_s": 5.0, "set": {}}]}, r"change\[1\].set = {}: "),
    ({"fault": [{"verb": "kil", "at_s": 1.0, "target": "4"}]}, r"fault\[1\].verb = 'kil'"),
    ({"fault": [{"verb": "kill", "at": 1.0, "target": "4"}]}, r"unknown key 'at' in \[fault\[1\]\]"),
]


@pytest.mark.parametrize(("overrides", "words"), MISTAKES)
def test_every_mistake_is_one_clear_line(overrides: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioError, match=words) as caught:
        load("three_cells", overrides)
    message = str(caught.value)
    assert message.startswith("three_cells: ")
    assert "\n" not in message
    assert len(message) < 300


def numbers(table: Any, path: str = "") -> Iterator[str]:
    """Dotted keys of all numbers in a scenario's tables, set or not."""
    hints = get_type_hints(type(table))
    for field in dataclasses.fields(table):
        value, kinds = getattr(table, field.name), get_args(hints[field.name]) or (hints[field.name],)
        if dataclasses.is_dataclass(value):
            yield from numbers(value, f"{path}{field.name}.")
        elif {int, float} & set(kinds):
            yield path + field.name


@pytest.mark.parametrize("key", list(numbers(load("three_cells").tables)))
def test_every_number_is_bounded(key: str) -> None:
    for value in (1e300, -1e300, 10**30):
        with pytest.raises(ScenarioError, match=re.escape(key)) as caught:
            load("three_cells", {key: value})
        assert len(str(caught.value)) < 300


def test_overrides_do_not_leak_into_the_next_load() -> None:
    load("three_cells", {"radio.loss": 0.5, "station.safety_zone_m": [27.0, 34.0, 29.0, 36.0], "fault": ["kill:4@5"]})
    plain = load("three_cells")
    assert plain.tables.radio.loss == 0.0
    assert plain.tables.fault == ()
    assert dataclasses.astuple(plain.tables.station)[1] == (24.0, 29.0, 34.0, 41.0)
