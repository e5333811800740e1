"""Scenario files as people have them, and one line for every one that can't be read."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.scenario import ScenarioError, load, parse_set
from tests.helpers.map_files import room_map

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


def test_a_path_that_no_text_can_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room_map(tmp_path).rename(tmp_path / "caf\udce9.yaml")
    with pytest.raises(ScenarioError, match=r"caf\?\.yaml: .*not UTF-8"):
        load(tmp_path / "caf\udce9.yaml")
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(ScenarioError, match=r"room\.yaml: the working folder: No such file"):
        load("room.yaml")


def test_a_name_of_any_length_is_told_shortly() -> None:
    with pytest.raises(ScenarioError) as short:
        load("xx")
    for name in ("x" * 9000, "x" * 9000 + ".toml", "x\n" * 9000 + ".yaml"):
        with pytest.raises(ScenarioError, match=r"xx|File name too long") as caught:
            load(name)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < len(str(short.value)) + 100, "beside the names that are known"


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
