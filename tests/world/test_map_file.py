"""Images of ROS maps: read by the rules of nav2's map server, one line for those that can't be used, and written."""

from __future__ import annotations

import tempfile
from io import BytesIO
from pathlib import Path
from struct import pack
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from tests.helpers.map_files import YAML, one_line, write
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.grid.floor_plan import connected_parts
from world.grid.map_file import digest_of_map, load_map, read_map, save_map

REAL = [folder for above in Path(__file__).resolve().parents if (folder := above / "shared" / "maps").is_dir()]
"""Where this machine has the maps of real buildings; they are not part of the repository."""


def values(folder: Path, mode: str, levels: Any, rest: str = YAML) -> list[int]:
    """What nav2's rules make of one row of pixels."""
    return read_map(write(folder, rest + f"mode: {mode}\n", [levels]))[0][0].tolist()


def test_the_top_row_is_the_highest_y_and_negate_turns_black_and_white_around(tmp_path: Path) -> None:
    path = write(tmp_path, pixels=[[254, 0], [205, 254]])
    occupied, geometry = load_map(path)
    assert geometry == GridGeometry(2, 2, 0.1, -1.0, 2.0)
    assert occupied.tolist() == [[True, False], [False, True]]
    write(tmp_path, YAML.replace("negate: 0", "negate: 1"), [[254, 0], [205, 254]])
    assert read_map(path)[0].tolist() == [[OCCUPIED, OCCUPIED], [OCCUPIED, FREE]]


def test_trinary_and_scale_have_the_same_free_cells(tmp_path: Path) -> None:
    levels = [255, 254, 206, 205, 204, 90, 89, 0]
    expected = [FREE, FREE, FREE, UNKNOWN, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED]
    assert values(tmp_path, "trinary", levels) == expected
    assert values(tmp_path, "Scale", levels) == expected


def test_raw_pixels_are_percents_and_above_100_unknown(tmp_path: Path) -> None:
    levels = [0, 19, 20, 64, 65, 100, 101, 205, 255]
    expected = [FREE, FREE, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN]
    assert values(tmp_path, "raw", levels) == expected
    assert values(tmp_path, "raw", levels, YAML.replace("negate: 0", "negate: 1")) == expected


def test_a_pixel_at_a_threshold_is_past_it(tmp_path: Path) -> None:
    none_free = YAML.replace("0.196", "0").replace("0.65", "1.0")
    assert values(tmp_path, "trinary", [255, 254, 1, 0], none_free) == [FREE, UNKNOWN, UNKNOWN, OCCUPIED]
    equal = YAML.replace("0.196", "0.2").replace("0.65", "0.2")
    assert values(tmp_path, "trinary", [255, 204, 203], equal) == [FREE, FREE, OCCUPIED]


def test_whoever_is_not_opaque_is_unknown(tmp_path: Path) -> None:
    white = [[[255, 255, 255, 255], [255, 255, 255, 254], [255, 255, 255, 0], [0, 0, 0, 128]]]
    assert read_map(write(tmp_path, pixels=white))[0].tolist() == [[FREE, UNKNOWN, UNKNOWN, UNKNOWN]]
    assert values(tmp_path, "raw", [[0, 255], [0, 0]]) == [FREE, FREE], "gray and alpha"


def test_opaque_gray_with_an_alpha_channel_is_as_without(tmp_path: Path) -> None:
    pixels = [[[205, 205, 205, 255], [254, 254, 254, 255]]]
    assert read_map(write(tmp_path, pixels=pixels))[0].tolist() == [[UNKNOWN, FREE]]


def test_color_counts_by_its_luma(tmp_path: Path) -> None:
    green_red_blue = [[[0, 255, 0], [255, 0, 0], [0, 0, 255]]]
    yaml = YAML.replace("0.196", "0.42").replace("0.65", "0.8")
    assert read_map(write(tmp_path, yaml, green_red_blue))[0].tolist() == [[FREE, UNKNOWN, OCCUPIED]]


GRAY = np.array([[254, 205, 0], [0, 254, 254]], np.uint8)
CELLS = [[OCCUPIED, FREE, FREE], [FREE, UNKNOWN, OCCUPIED]]


def in_mode(mode: str) -> Image.Image:
    return Image.fromarray(GRAY).convert(mode)


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("gray.png", in_mode("L")),
        ("color.png", in_mode("RGB")),
        ("palette.png", in_mode("P")),
        ("palette.gif", in_mode("P")),
        ("deep.png", Image.fromarray(GRAY.astype(np.uint16) * 257)),
        ("deep.tiff", Image.fromarray(GRAY.astype(np.uint16) * 257)),
        ("gray.tiff", in_mode("L")),
        ("inks.tiff", in_mode("CMYK")),
        ("gray.bmp", in_mode("L")),
        ("gray.pgm", in_mode("L")),
        ("color.ppm", in_mode("RGB")),
        ("deep.pgm", Image.fromarray(GRAY.astype(np.int32) * 257)),
    ],
)
def test_images_of_many_kinds(tmp_path: Path, name: str, image: Image.Image) -> None:
    image.save(tmp_path / name)
    (tmp_path / "map.yaml").write_text(YAML.replace("map.png", name))
    assert read_map(tmp_path / "map.yaml")[0].tolist() == CELLS


def test_a_jpeg(tmp_path: Path) -> None:
    pixels = np.repeat(np.repeat(np.array([[254, 0], [0, 254]], np.uint8), 8, axis=0), 8, axis=1)
    Image.fromarray(pixels).save(tmp_path / "map.jpg", quality=95)
    (tmp_path / "map.yaml").write_text(YAML.replace("map.png", "map.jpg"))
    assert read_map(tmp_path / "map.yaml")[0][::8, ::8].tolist() == [[OCCUPIED, FREE], [FREE, OCCUPIED]]


@pytest.mark.parametrize(
    "data",
    [
        b"P2\n# CREATOR: a program\n3 2\n# and more\n254\n254 205 0\n0 254 254\n",
        b"P2 3 2 127  127 102 0  0 127 127",
        b"P5\n3 2\n# 5 bits\n31\n" + bytes([31, 25, 0, 0, 31, 31]),
        b"P5 3 2 65535\n" + (GRAY.astype(">u2") * 257).tobytes(),
        b"P5 3 2 1000\n" + (GRAY / 255 * 1000).round().astype(">u2").tobytes(),
    ],
)
def test_portable_gray_maps_of_any_depth(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "map.pgm").write_bytes(data)
    (tmp_path / "map.yaml").write_text(YAML.replace("map.png", "map.pgm").replace("0.196", "0.19"))
    assert read_map(tmp_path / "map.yaml")[0].tolist() == CELLS


def test_one_bit_a_pixel(tmp_path: Path) -> None:
    (tmp_path / "map.pbm").write_bytes(b"P1\n3 2\n0 0 1\n1 0 0\n")
    (tmp_path / "map.yaml").write_text(YAML.replace("map.png", "map.pbm"))
    assert load_map(tmp_path / "map.yaml")[0].tolist() == [[True, False, False], [False, False, True]]


def test_a_color_that_a_png_declares_transparent_is_unknown(tmp_path: Path) -> None:
    assert read_map(write(tmp_path, pixels=in_mode("L"), transparency=254))[0].tolist() == [
        [OCCUPIED, UNKNOWN, UNKNOWN], [UNKNOWN, UNKNOWN, OCCUPIED]
    ]  # fmt: skip
    deep = Image.fromarray(GRAY.astype(np.uint16) * 257)
    assert read_map(write(tmp_path, pixels=deep, transparency=0))[0].tolist() == [
        [UNKNOWN, FREE, FREE], [FREE, UNKNOWN, UNKNOWN]
    ]  # fmt: skip


def encoded(image: Image.Image, kind: str, **how: Any) -> bytes:
    file = BytesIO()
    image.save(file, kind, **how)
    return file.getvalue()


def png_of(width: int, height: int) -> bytes:
    """A PNG that only says that it is so large."""
    head = b"IHDR" + pack(">II5B", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + pack(">I", 13) + head + pack(">I", crc32(head)) + pack(">I", 100) + b"IDAT"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (encoded(Image.effect_noise((50, 50), 99.0), "PNG")[:-500], "not a complete PNG"),
        (encoded(in_mode("L"), "PPM")[:-2], "not a complete PNG"),
        (b"P5 3 2 31\n\0", "not a complete PNG"),
        (b"P2 3 2 255 1 2 3 4 5 x", "not a complete PNG"),
        (encoded(in_mode("L"), "TIFF")[:40], "not a complete PNG"),
        (encoded(in_mode("F"), "TIFF"), "not a complete PNG"),
        (encoded(Image.fromarray(GRAY.astype(np.int32) << 20), "TIFF"), "not a complete PNG"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "not a complete PNG"),
        (b"", "not a complete PNG"),
        (png_of(14_000, 14_000), "14,000 x 14,000 cells; up to 25,000,000|more than 25,000,000 pixels"),
        (png_of(10_000, 9_000), "9,000 x 10,000 cells; up to 25,000,000"),
        (png_of(5_001, 5_000), "5,000 x 5,001 cells; up to 25,000,000"),
        (png_of(0, 5), "not a complete PNG|5 x 0 cells"),
    ],
)
def test_an_image_that_cannot_be_used_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes, words: str
) -> None:
    write(tmp_path)
    (tmp_path / "map.png").write_bytes(data)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=words) as caught:
        load_map(Path("map.yaml"))
    one_line(str(caught.value))


SOURCES = [
    YAML.encode(),
    *(encoded(in_mode(mode), kind) for mode, kind in [
        ("L", "PNG"), ("RGBA", "PNG"), ("P", "GIF"), ("L", "PPM"), ("RGB", "BMP"), ("RGB", "JPEG"), ("L", "TIFF"),
    ]),
    encoded(in_mode("L"), "TIFF", compression="tiff_lzw"),
    b"P2 3 2 255 1 2 3 4 5 6",
]  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A good file with some bytes changed, or its end lost; or no file at all."""
    source = draw(st.sampled_from(SOURCES))
    for at, by in draw(st.lists(st.tuples(st.integers(0, 400), st.binary(min_size=1, max_size=4)), max_size=6)):
        at %= len(source)
        source = source[:at] + by + source[at + len(by) :]
    return draw(st.sampled_from([source, source[: draw(st.integers(0, len(source)))], draw(st.binary(max_size=60))]))


@settings(max_examples=300, deadline=None)
@given(damaged(), st.booleans())
def test_whatever_the_files_hold_it_is_a_map_or_one_line(data: bytes, as_yaml: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder), data if as_yaml else YAML)
        if not as_yaml:
            (path.parent / "map.png").write_bytes(data)
        message = ""
        try:
            cells, geometry = read_map(path)
        except ValueError as error:
            message = str(error)
        else:
            assert cells.shape == (geometry.rows, geometry.cols)
            assert set(np.unique(cells).tolist()) <= {FREE, OCCUPIED, UNKNOWN}
    assert len(message) < 300
    assert message.isprintable()


cells = arrays(np.int8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.sampled_from([-1, 0, 1]))


@settings(max_examples=40, deadline=None)
@given(cells, st.sampled_from([0.001, 0.05, 0.5, 1 / 3]), st.floats(-50, 50), st.floats(-50, 50))
def test_a_map_comes_back_as_it_was_saved(grid: NDArray[np.int8], res: float, x0: float, y0: float) -> None:
    geometry = GridGeometry(*grid.shape, res, x0, y0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.yaml"
        save_map(path, geometry, grid)
        again = read_map(path)
    assert again[1] == geometry
    np.testing.assert_array_equal(again[0], grid)


def test_saved_pixels_are_those_of_map_server(tmp_path: Path) -> None:
    grid = np.array([[FREE, OCCUPIED, UNKNOWN], [OCCUPIED, FREE, FREE]], np.int8)
    save_map(tmp_path / "map.yaml", GridGeometry(2, 3), grid)
    assert (tmp_path / "map.pgm").read_bytes()[:2] == b"P5"
    with Image.open(tmp_path / "map.pgm") as image:
        assert np.asarray(image).tolist() == [[0, 254, 254], [254, 0, 205]]


def test_digest_changes_with_the_image(tmp_path: Path) -> None:
    path = write(tmp_path)
    before = digest_of_map(path)
    assert before == digest_of_map(path)
    write(tmp_path, pixels=[[0]])
    assert digest_of_map(path) != before


@pytest.mark.skipif(not REAL, reason="the maps of real buildings are not on this machine")
@pytest.mark.parametrize(
    ("name", "free", "largest"),
    [
        ("hospital_native", 534_951, 527_191),
        ("hospital_025", 17_912, 17_899),
        ("warehouse_native", 1_422_292, 1_421_654),
    ],
)
def test_maps_of_real_buildings(tmp_path: Path, name: str, free: int, largest: int) -> None:
    cells, geometry = read_map(REAL[0] / f"{name}.yaml")
    assert np.count_nonzero(cells == FREE) == free
    assert np.bincount(connected_parts(cells != FREE).ravel())[1:].max() == largest
    save_map(tmp_path / "map.yaml", geometry, cells)
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml")[0], cells)
