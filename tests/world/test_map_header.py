"""YAML files of ROS maps as people have them, and one line for every one that can't be used."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.helpers.map_files import METRES, ORIGIN, YAML, one_line, write
from world.grid import FREE, OCCUPIED, GridGeometry
from world.grid.map_file import load_map, read_map


@pytest.mark.parametrize(
    "yaml",
    [
        YAML.replace(METRES, "1e-1\n"),
        YAML.replace(METRES, "'0.1'\n"),
        YAML.replace(METRES, "+.1 # metres\n"),
        YAML.replace("resolution: ", "resolution:\t"),
        YAML.replace(": ", ":\t"),
        YAML.replace("\n", "\r\n"),
        "\ufeff" + YAML,
        YAML.encode("utf-16"),
        b"\xfe\xff" + YAML.encode("utf-16-be"),
        b"# Geb\xe4ude 3\n" + YAML.encode(),
        "%YAML 1.1\n---\n" + YAML + "---\nimage: other.png\n",
        YAML.replace(ORIGIN, "[-1, '2', 1.0e-10]"),
        YAML.replace(ORIGIN, "[-1.0, 2.0, -0.0]"),
        YAML.replace(ORIGIN, "[-1.0, 2.0, 6.283185307179586]"),
        YAML.replace(ORIGIN, "\n  - -1.0\n  - 2.0\n  - 0.0"),
        YAML.replace(ORIGIN, "\n\t- -1.0\n\t- 2.0\n\t- 0.0"),
        YAML.replace("negate: 0", "negate: false"),
        YAML.replace("negate: 0", 'negate: "No"'),
        YAML.replace("negate: 0\n", ""),
        YAML + "mode: trinary\n",
        YAML + "mode: 'Trinary'\n",
        YAML + "map_version: !!python/object:os.system {}\ncost: [1, {}]\n? [a, b]\n: c\n",
        YAML.replace("map.png", "./map.png"),
        YAML.replace("map.png", "!!str 'map.png'"),
    ],
)
def test_a_yaml_file_as_people_have_it(tmp_path: Path, yaml: str | bytes) -> None:
    cells, geometry = read_map(write(tmp_path, yaml))
    assert geometry == GridGeometry(1, 1, 0.1, -1.0, 2.0)
    assert cells.tolist() == [[FREE]]


@pytest.mark.parametrize("negate", ["1", "true", '"true"', "True", "yes", "on"])
def test_negate_may_be_a_word(tmp_path: Path, negate: str) -> None:
    assert read_map(write(tmp_path, YAML.replace("negate: 0", f"negate: {negate}")))[0].tolist() == [[OCCUPIED]]


def test_the_image_lies_beside_a_link_as_it_was_named(tmp_path: Path) -> None:
    stored, used = tmp_path / "stored", tmp_path / "used"
    stored.mkdir()
    used.mkdir()
    write(stored, pixels=[[0]])
    (used / "map.yaml").symlink_to(stored / "map.yaml")
    Image.fromarray(np.array([[254]], np.uint8)).save(used / "map.png")
    assert read_map(used / "map.yaml")[0].tolist() == [[FREE]]


def test_an_image_elsewhere(tmp_path: Path) -> None:
    path = write(tmp_path, YAML.replace("map.png", str(tmp_path / "Bürö 1" / "map.png")))
    (tmp_path / "Bürö 1").mkdir()
    (tmp_path / "map.png").rename(tmp_path / "Bürö 1" / "map.png")
    assert read_map(path)[0].tolist() == [[FREE]]
    path.write_text(YAML.replace("map.png", "Bürö 1/map.png"), encoding="utf-8")
    assert read_map(path)[0].tolist() == [[FREE]]
    assert read_map(path, "Bürö 1/../Bürö 1/map.png")[0].tolist() == [[FREE]], "whatever the YAML file says"


def test_a_yaw_counts_by_what_it_moves(tmp_path: Path) -> None:
    turned = YAML.replace(ORIGIN, "[0, 0, 0.001]")
    assert load_map(write(tmp_path, turned, np.zeros((1, 400)))) is not None
    with pytest.raises(ValueError, match=r"yaw of 0\.001"):
        load_map(write(tmp_path, turned, np.zeros((1, 600))))


@pytest.mark.parametrize(
    ("yaml", "words"),
    [
        ("image: [", r"not a YAML file \(line 1\)"),
        ("[" * 5000, "not a YAML file"),
        ("{a: " * 5000, "not a YAML file"),
        ('image: "\\UFFFFFFFF"', "not a YAML file"),
        ("image: \0", "not a YAML file"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not a YAML file"),
        ("image: *" + "a" * 9000, "not a YAML file"),
        ("", "names no image"),
        ("just text", "names no image"),
        ("- image: map.png", "names no image"),
        (YAML.replace("map.png", ""), "image is empty"),
        (YAML.replace("map.png", "[map.png]"), "image is a list"),
        (YAML.replace("map.png", "{a: map.png}"), "image is a mapping"),
        ("x: &a [*a]\n" + YAML.replace(METRES, "*a\n"), "resolution is a list"),
        ("# " + "x" * 70_000, "larger than 65,536 bytes"),
        (YAML.replace(METRES, "0\n"), "resolution = 0 is not above 0"),
        (YAML.replace(METRES, "-0.5\n"), "resolution = -0.5 is not above 0"),
        (YAML.replace(METRES, ".nan\n"), "resolution = .nan is not a finite number"),
        (YAML.replace(METRES, "1e999\n"), "resolution = 1e999 is not a finite number"),
        (YAML.replace(METRES, "0,1\n"), "resolution = 0,1 is not a finite number"),
        (YAML.replace(METRES, "x" * 5000 + "\n"), "resolution = xxx.*xxx is not a finite number"),
        (YAML.replace(METRES, "5e-5\n"), "a resolution of 5e-05 m; 0.001 m or more is possible"),
        (YAML.replace("resolution: 0.1\n", ""), "resolution is missing"),
        (YAML.replace(METRES, "\n"), "resolution is empty"),
        (YAML + "resolution: 0.2\n", r"resolution is given twice \(line 7\)"),
        (YAML.replace(ORIGIN, "[0.0, 0.0, 1.5]"), "origin has a yaw of 1.5; only maps without rotation"),
        (YAML.replace(ORIGIN, "[0.0, 0.0, .inf]"), "origin = .inf is not a finite number"),
        (YAML.replace(ORIGIN, "here"), r"origin is not \[x, y, yaw\]"),
        (YAML.replace(ORIGIN, "[1, 2, 3, 4]"), r"origin is not \[x, y, yaw\]"),
        (YAML.replace(ORIGIN, "[1, [2], 3]"), "origin is a list"),
        (
            YAML.replace(ORIGIN, "[447000.5, 5400000.25, 0]"),
            r"5400000\.\d+ m from \(0, 0\); up to 20,000 m",
        ),
        (YAML.replace("0.65", "0.1"), "free_thresh = 0.196, occupied_thresh = 0.1: needs 0 <= free_thresh <= occupied"),
        (YAML.replace("0.65", "65"), "occupied_thresh <= 1"),
        (YAML.replace("0.196", "-0.1"), "free_thresh = -0.1"),
        (YAML.replace("negate: 0", "negate: 2"), "negate = 2 is neither 0 nor 1"),
        (YAML.replace("negate: 0", "negate: maybe"), "negate = maybe"),
        (YAML + "mode: binary\n", "mode = binary is none of trinary, scale, raw"),
        (YAML.replace("map.png", "other.png"), "image: .*other.png: No such file"),
        (YAML.replace("map.png", r"maps\map.png"), "No such file or directory; a path has / between its folders"),
        (YAML.replace("map.png", "map.yaml"), "not a complete PNG, PGM"),
        (YAML.replace("map.png", "x" * 5000), "image: .*File name too long"),
        (YAML.replace("map.png", '"a\\0b"'), "image: .*null"),
        (YAML.replace("map.png", "."), "a folder, not a file"),
        (YAML.replace("map.png", "/dev/zero"), "/dev/zero: a pipe or a device, not a file"),
    ],
)
def test_a_map_that_cannot_be_used_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, yaml: str | bytes, words: str
) -> None:
    write(tmp_path, yaml)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=words) as caught:
        load_map(Path("map.yaml"))
    one_line(str(caught.value))


def test_no_such_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"map\.yaml: No such file"):
        load_map(Path("map.yaml"))
    os.mkfifo("map.yaml")
    with pytest.raises(ValueError, match=r"map\.yaml: a pipe or a device"):
        load_map(Path("map.yaml"))
    with pytest.raises(ValueError, match="a folder"):
        load_map(tmp_path)
