"""Floor plans from rectangles, and which floor is connected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from world.grid.floor_plan import connected_parts, from_rectangles, reachable, resampled
from world.grid.geometry import MAX_CELLS, GridGeometry, check_grid


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


@pytest.mark.parametrize(
    ("rows", "cols", "resolution_m", "x0_m", "words"),
    [
        (5000, 5001, 0.05, 0.0, "5,000 x 5,001 cells; up to 25,000,000"),
        (0, 5, 0.05, 0.0, "0 x 5 cells"),
        (10, 10, 0.00005, 0.0, "a resolution of 5e-05 m; 0.001 m or more"),
        (10, 10, float("nan"), 0.0, "a resolution of nan"),
        (10, 10, 1e300, 0.0, "as far as 1e\\+301 m"),
        (10, 10, 0.05, 447_000.5, "as far as 447001 m from .* up to 20,000 m"),
        (10, 10, 0.05, -1e308, "as far as 1e\\+308 m"),
    ],
)
def test_a_grid_that_no_run_can_have(rows: int, cols: int, resolution_m: float, x0_m: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        check_grid(rows, cols, resolution_m, x0_m)


def test_the_largest_grid() -> None:
    assert check_grid(5000, 5000, 0.001).size == MAX_CELLS


@pytest.mark.parametrize(("size_m", "resolution_m"), [((1e6, 1e6), 0.01), ((1e308, 1e308), 1e-308), ((3, 1e300), 1)])
def test_a_grid_too_large_is_refused_before_it_is_made(size_m: tuple[float, float], resolution_m: float) -> None:
    with pytest.raises(ValueError, match="cells; up to"):
        from_rectangles(size_m, [(0, 0, 1, 1)], [], resolution_m)


@given(
    st.integers(1, 12), st.integers(1, 12), st.sampled_from([0.05, 0.5, 1.0]),
    *[st.floats(-15, 15)] * 6,
)  # fmt: skip
def test_a_rectangle_has_the_cells_whose_centers_it_holds(
    rows: int, cols: int, res: float, x: float, y: float, x0: float, y0: float, x1: float, y1: float
) -> None:
    geometry = GridGeometry(rows, cols, res, x, y)
    centers = geometry.centers(np.arange(geometry.size))
    inside = ((centers > (x0, y0)) & (centers < (x1, y1))).all(axis=1)
    np.testing.assert_array_equal(geometry.rectangle(x0, y0, x1, y1), np.flatnonzero(inside))


def test_reachable_goes_over_sides_not_corners() -> None:
    occupied = np.array([[0, 0, 1], [1, 1, 0], [0, 0, 0]], bool)
    assert reachable(occupied, 0).tolist() == [[True, True, False], [False] * 3, [False] * 3]
    assert not reachable(occupied, 2).any()


@given(arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))), st.data())
def test_what_is_reachable_is_what_steps_over_sides_reach(occupied: NDArray[np.bool_], data: st.DataObject) -> None:
    index = data.draw(st.integers(0, occupied.size - 1))
    reached, ahead = np.zeros_like(occupied), [divmod(index, occupied.shape[1])]
    while ahead:
        row, col = ahead.pop()
        inside = 0 <= row < occupied.shape[0] and 0 <= col < occupied.shape[1]
        if inside and not occupied[row, col] and not reached[row, col]:
            reached[row, col] = True
            ahead += [(row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)]
    np.testing.assert_array_equal(reachable(occupied, index), reached)


def test_parts_are_numbered_and_walls_are_none() -> None:
    occupied = np.array([[0, 1, 0], [0, 1, 1], [1, 1, 0]], bool)
    assert connected_parts(occupied).tolist() == [[1, 0, 2], [1, 0, 0], [0, 0, 3]]


@pytest.mark.parametrize("resolution_m", [0.1, 0.25, 0.3, 0.5, 0.7, 2.0])
@given(arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9))))
def test_a_resampled_cell_is_wall_where_any_of_it_is(resolution_m: float, occupied: NDArray[np.bool_]) -> None:
    """Held against the areas of rectangles: an old and a new cell that overlap by more than rounding."""
    old = check_grid(*occupied.shape, 0.25, -3.0, 7.0)
    walls, new = resampled(occupied, old, resolution_m)
    assert (new.resolution_m, new.x0_m, new.y0_m) == (resolution_m, -3.0, 7.0)

    def free(row: int, col: int) -> bool:
        """Within the old grid, and over no wall of it."""
        top, right = (row + 1) * resolution_m, (col + 1) * resolution_m
        if top > old.rows * 0.25 + 1e-6 or right > old.cols * 0.25 + 1e-6:
            return False
        return not any(
            min(top, (i + 1) * 0.25) - max(row * resolution_m, i * 0.25) > 1e-6
            and min(right, (j + 1) * 0.25) - max(col * resolution_m, j * 0.25) > 1e-6
            for i, j in np.argwhere(occupied).tolist()
        )

    assert walls.tolist() == [[not free(row, col) for col in range(new.cols)] for row in range(new.rows)]
    assert new.rows * resolution_m + 1e-6 >= old.rows * 0.25 > (new.rows - 1) * resolution_m + 1e-6


def test_a_grid_in_cells_that_no_run_can_have() -> None:
    floor, geometry = np.zeros((3, 3), np.bool_), GridGeometry(3, 3, 1.0)
    with pytest.raises(ValueError, match="cells; up to"):
        resampled(floor, geometry, 1e-300)
    with pytest.raises(ValueError, match="as far as 1e\\+18 m"):
        resampled(floor, geometry, 1e18)
    assert resampled(floor, geometry, 1e4)[0].tolist() == [[True]]
