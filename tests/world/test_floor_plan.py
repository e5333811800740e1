"""Floor plans from rectangles and from ROS maps."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from world.floor_plan import digest_of_map, from_rectangles, load_map, reachable, save_map
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

YAML = (
    "image: map.png\nresolution: 0.1\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def write(folder: Path, yaml: str = YAML, pixels: object = None) -> Path:
    if pixels is not None:
        Image.fromarray(np.array(pixels, np.uint8)).save(folder / "map.png")
    path = folder / "map.yaml"
    path.write_text(yaml)
    return path


def test_rectangles_carve_and_walls_go_back() -> None:
    occupied, geometry = from_rectangles((4.0, 3.0), [(0.5, 0.5, 3.5, 2.5)], [(1.5, 0.5, 2.0, 1.5)], 0.5)
    assert geometry == GridGeometry(6, 8, 0.5)
    drawn = ["".join("#" if wall else "." for wall in row) for row in occupied[::-1]]
    assert drawn == ["########", "#......#", "#......#", "#..#...#", "#..#...#", "########"]


@pytest.mark.parametrize(
    ("free", "words"),
    [((1.0, 1.0, 1.0, 2.0), "x0 < x1"), ((0.0, 0.0, 9.0, 1.0), "outside size_m"), ((-1.0, 0.0, 2.0, 1.0), "outside")],
)
def test_bad_rectangles(free: tuple[float, float, float, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        from_rectangles((4.0, 3.0), [free], [], 0.5)


def test_a_grid_too_large_is_refused_before_it_is_made() -> None:
    with pytest.raises(ValueError, match="cells"):
        from_rectangles((1e6, 1e6), [(0, 0, 1, 1)], [], 0.01)


def test_reachable_goes_over_sides_not_corners() -> None:
    occupied = np.array([[0, 0, 1], [1, 1, 0], [0, 0, 0]], bool)
    assert reachable(occupied, 0).tolist() == [[True, True, False], [False] * 3, [False] * 3]
    assert not reachable(occupied, 2).any()


@given(arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))), st.data())
def test_what_is_reachable_is_one_connected_part(occupied: NDArray[np.bool_], data: st.DataObject) -> None:
    index = data.draw(st.integers(0, occupied.size - 1))
    parts, _ = ndimage.label(~occupied)
    expected = (parts == parts.flat[index]) & ~occupied
    np.testing.assert_array_equal(reachable(occupied, index), expected)


cells = arrays(np.int8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.sampled_from([-1, 0, 1]))


@settings(max_examples=40, deadline=None)
@given(cells, st.sampled_from([0.05, 0.5, 1.0]), st.floats(-50, 50), st.floats(-50, 50))
def test_save_and_load(grid: np.ndarray[tuple[int, int], np.dtype[np.int8]], res: float, x0: float, y0: float) -> None:
    geometry = GridGeometry(*grid.shape, res, x0, y0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.yaml"
        save_map(path, geometry, grid)
        occupied, again = load_map(path)
    assert again == geometry
    assert (occupied == (grid != FREE)).all()


def test_saved_pixels_are_those_of_map_server(tmp_path: Path) -> None:
    grid = np.array([[FREE, OCCUPIED, UNKNOWN], [OCCUPIED, FREE, FREE]], np.int8)
    save_map(tmp_path / "map.yaml", GridGeometry(2, 3), grid)
    assert (tmp_path / "map.pgm").read_bytes()[:2] == b"P5"
    with Image.open(tmp_path / "map.pgm") as image:
        assert np.asarray(image).tolist() == [[0, 254, 254], [254, 0, 205]]


def test_png_with_thresholds_negation_and_top_row_first(tmp_path: Path) -> None:
    path = write(tmp_path, pixels=[[254, 0], [205, 254]])
    occupied, geometry = load_map(path)
    assert geometry == GridGeometry(2, 2, 0.1, -1.0, 2.0)
    assert occupied.tolist() == [[True, False], [False, True]]
    write(tmp_path, YAML.replace("negate: 0", "negate: 1"))
    assert load_map(path)[0].tolist() == [[True, True], [True, False]]


def test_transparent_counts_as_unknown_and_color_by_its_mean(tmp_path: Path) -> None:
    write(tmp_path, pixels=[[[255, 255, 255, 255], [255, 255, 255, 0]], [[0, 0, 0, 255], [255, 240, 255, 255]]])
    assert load_map(tmp_path / "map.yaml")[0].tolist() == [[True, False], [False, True]]


@pytest.mark.parametrize(
    ("yaml", "words"),
    [
        ("image: [", "not a YAML file"),
        ("just text", "names no image"),
        (YAML.replace("0.1", "0"), "resolution = 0 is not above 0"),
        (YAML.replace("0.1", "-0.5"), "resolution"),
        (YAML.replace("0.1", ".nan"), "resolution = nan is not a finite number"),
        (YAML.replace("resolution: 0.1\n", ""), "resolution = None"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "[0.0, 0.0, 1.5]"), "yaw"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "here"), "origin"),
        (YAML.replace("0.65", "0.1"), "free_thresh < occupied_thresh"),
        (YAML.replace("negate: 0", "negate: 2"), "negate"),
        (YAML.replace("map.png", "other.png"), "no such image"),
        (YAML.replace("map.png", "map.yaml"), "not an image"),
    ],
)
def test_bad_maps_say_so_in_one_line(tmp_path: Path, yaml: str, words: str) -> None:
    path = write(tmp_path, yaml, [[254]])
    with pytest.raises(ValueError, match=words) as caught:
        load_map(path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_missing_map(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="No such file"):
        load_map(tmp_path / "none.yaml")


def test_truncated_image(tmp_path: Path) -> None:
    path = write(tmp_path, pixels=np.zeros((50, 50)))
    image = tmp_path / "map.png"
    image.write_bytes(image.read_bytes()[:60])
    with pytest.raises(ValueError, match="not an image that can be read"):
        load_map(path)


def test_digest_changes_with_the_image(tmp_path: Path) -> None:
    path = write(tmp_path, pixels=[[254]])
    before = digest_of_map(path)
    assert before == digest_of_map(path)
    write(tmp_path, pixels=[[0]])
    assert digest_of_map(path) != before
