"""Scenarios: what comes with the emulator, the way back through TOML, and one clear line for every mistake."""

from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.scenario import Scenario, ScenarioError, load, names, parse_set
from world.config import Fault
from world.grid import FREE, OCCUPIED, GridGeometry
from world.grid.lines import line_of_sight
from world.grid.map_file import save_map


def room_map(folder: Path) -> Path:
    """A ROS map of one closed room of 10 x 8 m with a wall in it."""
    cells = np.full((20, 24), OCCUPIED, np.int8)
    cells[2:18, 2:22] = FREE
    cells[2:10, 5] = OCCUPIED
    path = folder / "room.yaml"
    save_map(path, GridGeometry(20, 24, 0.5, -5.0, -4.0), cells)
    return path


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


def test_the_barrier_closes_the_way_to_cell_3() -> None:
    for arena, cell_3 in [("three_cells", [33, 52, 50, 67.5]), ("three_cells_wide", [37, 60, 57, 78])]:
        closed = load(f"{arena}_barrier")
        assert closed.cell_names == ("1", "2")
        free = np.count_nonzero(~load(arena).arena.occupied) - np.count_nonzero(~closed.arena.occupied)
        assert free == 2 * 6, "1 x 3 m of barrier"
        with pytest.raises(ScenarioError, match=r"cell '3'.*reached"):
            load(f"{arena}_barrier", {"cell": [{"name": "3", "rectangle_m": cell_3}]})


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


TOML = 'name = "mine"\nrobots = 3\n[floor_plan]\nsize_m = [12.0, 9.0]\nfree = [[1, 1, 11, 8]]\n'


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + TOML.encode(),
        TOML.encode("utf-16"),
        TOML.replace("\n", "\r\n").encode(),
        TOML.replace("\n", "\r").encode(),
        TOML.replace("= ", "=\t").encode(),
    ],
)
def test_a_text_file_as_people_have_it(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "Mine.TOML"
    path.write_bytes(data)
    assert load(path).robots == 3


def test_a_map_in_capitals_behind_a_link_and_from_the_home_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = load(room_map(tmp_path)).arena
    used = tmp_path / "used"
    used.mkdir()
    (used / "Room.YAML").symlink_to(tmp_path / "room.yaml")
    with pytest.raises(ScenarioError, match=r"used/room\.pgm: No such file"):
        load(used / "Room.YAML")
    (tmp_path / "room.pgm").rename(used / "room.pgm")
    assert np.array_equal(load(used / "Room.YAML").arena.occupied, plain.occupied)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert np.array_equal(load("~/used/Room.YAML").arena.occupied, plain.occupied)
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[floor_plan]\nmap = "~/used/Room.YAML"\n')
    assert np.array_equal(load(path).arena.occupied, plain.occupied)


def two_rooms(folder: Path, *more: str) -> Path:
    """A closed booth of 4 x 4 m in the middle of a floor of 30 x 20 m with 2 m of wall around it."""
    path = folder / "two.toml"
    plan = "size_m = [30, 20]\nfree = [[0, 0, 30, 20]]\nwalls = [[11, 6, 19, 14]]\nresolution_m = 0.5\n"
    booth = (
        plan.replace("walls", "#walls") + "walls = [[11, 6, 19, 8], [11, 12, 19, 14], [11, 6, 13, 14], [17, 6, 19, 14]]"
    )
    path.write_text("\n".join(['name = "two"', "[floor_plan]", booth, *more, ""]))
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


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"robots": 0}, "robots = 0"),
    ({"robots": -3}, "robots = -3"),
    ({"robots": 9.5}, "robots = 9.5"),
    ({"robots": True}, "robots = True"),
    ({"radius_m": float("nan")}, "radius_m = nan: should be a finite number"),
    ({"radius_m": float("inf")}, "radius_m = inf"),
    ({"radius_m": 0}, "radius_m = 0: should be greater than 0"),
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
    ({"station.position_m": [28.0]}, r"station.position_m\[2\] is missing"),
    ({"station.safety_zone_m": [0.0, 0.0, 3.0, 3.0]}, "does not hold the station"),
    ({"station.safety_zone_m": [20.0, 29.0, 34.0, 41.0]}, "holds a wall"),
    ({"cell": [{"name": "a", "rectangle_m": [0, 0, 1, 1]}]}, "cell 'a'.*no free place that can be reached"),
    ({"cell": [{"name": "a", "rectangle_m": [4, 20, 9, 30]}] * 2}, "cell name 'a' is taken"),
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


def test_no_room_for_the_robots_is_said(tmp_path: Path) -> None:
    path = tmp_path / "closet.toml"
    plan = {"size_m": [5.0, 5.0], "free": [[2.0, 2.0, 2.5, 2.5]]}
    path.write_text(tomli_w.dumps({"name": "closet", "floor_plan": plan, "victims": {"per_cell": 0}}))
    with pytest.raises(ScenarioError, match="no free place for robot 1 of 9"):
        load(path)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("three_cels", None, "did you mean 'three_cells'"),
        ("zzz", None, "known: .*three_cells"),
        ("none.toml", None, "No such file"),
        ("none.yaml", None, "No such file"),
        ("bad.toml", "name = ", r"bad\.toml: not TOML: .* \(at "),
        ("bad.toml", "a = " + "[" * 5000, r"bad\.toml: not TOML: nested too deeply"),
        ("bad.toml", "a = " + "9" * 5000, r"bad\.toml: not TOML: .*4300 digits"),
        ("bad.toml", "x" * 5000 + " = 1\n" + "x" * 5000 + " = 1\n", r"bad\.toml: not TOML: "),
        ("bad.toml", "# " + "x" * 2_000_000, "larger than 1,048,576 bytes"),
        ("bad.toml", "a = '\udcff'", r"bad\.toml: not a text file: byte 6 is not utf-8"),
        ("bad.toml", 'robots = 3\n[floor_plan]\nmap = "x"\n', "name is missing"),
        ("bad.toml", 'name = "x"\n', "floor_plan is missing"),
        ("bad.toml", 'name = "x"\nduration_s = 2026-01-01\n[floor_plan]\nmap="x"\n', "duration_s"),
    ],
)
def test_bad_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str | None, words: str) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path(name).write_text(text, "utf-8", "surrogateescape")
    with pytest.raises(ScenarioError, match=words) as caught:
        load(name)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


def test_no_source_that_never_ends_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.toml")
    os.mkfifo("pipe.yaml")
    Path("folder.toml").mkdir()
    Path("endless.toml").symlink_to("/dev/zero")
    Path("circle.yaml").symlink_to("circle.yaml")
    for name, words in {
        "pipe.toml": "a pipe or a device, not a file",
        "pipe.yaml": "a pipe or a device, not a file",
        "folder.toml": "a folder, not a file",
        "endless.toml": "a pipe or a device, not a file",
        "circle.yaml": "symbolic links",
    }.items():
        with pytest.raises(ScenarioError, match=words):
            load(name)


def test_a_name_of_any_length_is_told_shortly() -> None:
    for name in ("x" * 9000, "x" * 9000 + ".toml", "x\n" * 9000 + ".yaml"):
        with pytest.raises(ScenarioError, match=r"xx|File name too long") as caught:
            load(name)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 300


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 400), st.binary(max_size=4)), max_size=4), st.integers(0, 400),
    st.sampled_from([b"", b"[" * 2000, b"{a=" * 2000, b"0x" + b"f" * 9000, b"9" * 9000, b'"\\UFFFFFFFF"', b"1e999"]),
)  # fmt: skip
def test_whatever_the_file_holds_it_is_a_scenario_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, bytes]], end: int, value: bytes
) -> None:
    data = TOML.encode()
    for at, by in changes:
        data = data[: at % len(data)] + by + data[at % len(data) + len(by) :]
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes((data if end % 2 else data[:end]) + b"\n[radio]\nloss = " + value)
    message = ""
    try:
        load(path)
    except ScenarioError as error:
        message = str(error)
    assert message.isprintable()
    assert len(message) < 300


def test_set_takes_toml_values_and_bare_words() -> None:
    assert parse_set("radio.loss=0.1") == ("radio.loss", 0.1)
    assert parse_set("radio.model = disk_los") == ("radio.model", "disk_los")
    assert parse_set('radio.model="disk_los"') == ("radio.model", "disk_los")
    assert parse_set("rules.routing.sticky=false") == ("rules.routing.sticky", False)
    assert parse_set("station.position_m=[1, 2.5]") == ("station.position_m", [1, 2.5])
    for bad in (
        "radio.loss",
        "=1",
        "a=",
        "a=1\nb=2",
        "a=[1",
        "a=1 2",
        "a=" + "[" * 5000,
        "a=" + "9" * 5000,
        "a" * 5000,
    ):
        with pytest.raises(ScenarioError) as caught:
            parse_set(bad)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 300


def test_overrides_do_not_leak_into_the_next_load() -> None:
    load("three_cells", {"radio.loss": 0.5, "station.safety_zone_m": [27.0, 34.0, 29.0, 36.0], "fault": ["kill:4@5"]})
    plain = load("three_cells")
    assert plain.tables.radio.loss == 0.0
    assert plain.tables.fault == ()
    assert dataclasses.astuple(plain.tables.station)[1] == (24.0, 29.0, 34.0, 41.0)
