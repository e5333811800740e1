"""Shortest paths over the known free cells of a robot's own map.

A step leads to one of eight neighboring cells. A diagonal step needs both cells that it passes between.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import _floor, _search
from agents.found_bodies import Found
from agents.own_map import OwnMap
from world.grid import FREE, OCCUPIED, GridGeometry

_BOX_STEP: Final = 64
"""Rows and columns by which the part of the grid grows in which unlimited searches run."""


class Window:
    """A part of the grid in which a search runs, with a rim of cells that no path enters."""

    def __init__(self, geometry: GridGeometry, rows: tuple[int, int], cols: tuple[int, int]) -> None:
        """`rows` and `cols`: from the first to before the last."""
        self.geometry = geometry
        self.first_row, self.first_col = rows[0] - 1, cols[0] - 1
        self.rows, self.cols = rows[1] - rows[0] + 2, cols[1] - cols[0] + 2

    def index(self, cell: int) -> int:
        """Index within the window; of a cell outside it, some cell of the rim."""
        row, col = divmod(cell, self.geometry.cols)
        row = min(max(row - self.first_row, 0), self.rows - 1)
        return row * self.cols + min(max(col - self.first_col, 0), self.cols - 1)

    def indices(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """As `index`, of many cells, shape (n,)."""
        rows, cols = np.divmod(cells, self.geometry.cols)
        rows = np.clip(rows - self.first_row, 0, self.rows - 1)
        inside: NDArray[np.int64] = rows * self.cols + np.clip(cols - self.first_col, 0, self.cols - 1)
        return inside

    def inside(self, indices: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which indices are not on the rim, shape (n,)."""
        rows, cols = np.divmod(indices, self.cols)
        inside: NDArray[np.bool_] = (rows > 0) & (rows < self.rows - 1) & (cols > 0) & (cols < self.cols - 1)
        return inside

    def cells(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """The cells of the grid at indices within the window, none on the rim; shape (n,)."""
        rows, cols = np.divmod(indices, self.cols)
        cells: NDArray[np.int64] = (rows + self.first_row) * self.geometry.cols + cols + self.first_col
        return cells

    def cut(self, grid: NDArray[np.int8]) -> NDArray[np.int8]:
        """(rows * cols,) what a flat grid holds in the window, and OCCUPIED on the rim."""
        out = np.full((self.rows, self.cols), OCCUPIED, np.int8)
        first_row, first_col = self.first_row + 1, self.first_col + 1
        whole = grid.reshape(self.geometry.rows, self.geometry.cols)
        out[1:-1, 1:-1] = whole[first_row : first_row + self.rows - 2, first_col : first_col + self.cols - 2]
        return out.reshape(-1)


class Reach:
    """Path lengths from one cell to all others that can be reached over known free cells.

    Shortest path lengths are unique, paths are not. Of two cells that a path may come from, it comes from the one
    nearer to the source, and of two that are as near from the one with the lower index.
    """

    def __init__(self, source: int, window: Window) -> None:
        self.source = source
        self._window = window
        self._lengths_m = np.full(window.rows * window.cols, math.inf)
        self._lengths_m[window.index(source)] = 0.0
        self._blocks: NDArray[np.int64] | None = None
        """Blocks with a reached cell; None until `length_near_m` needs them."""

    def length_m(self, cell: int) -> float:
        """Path length to a cell; infinite if no path led there at the time of the search."""
        return float(self._lengths_m[self._window.index(cell)])

    def lengths_m(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Path lengths to many cells, shape (n,)."""
        lengths: NDArray[np.float64] = self._lengths_m[self._window.indices(cells)]
        return lengths

    def reached(self) -> NDArray[np.int64]:
        """All cells that can be reached, ascending."""
        return self._window.cells(np.flatnonzero(self._lengths_m < math.inf))

    def length_near_m(self, x_m: float, y_m: float) -> float:
        """Path length to the reached cell whose center is nearest to a place, plus the straight line from there."""
        w, g = self._window, self._window.geometry
        if self._blocks is None:
            self._blocks = _search.reached_blocks(self._lengths_m, w.rows, w.cols)
        return _search.length_near(
            self._lengths_m, w.rows, w.cols, self._blocks, w.first_row, w.first_col,
            g.resolution_m, g.x0_m, g.y0_m, x_m, y_m,
        )  # fmt: skip

    def path(self, cell: int) -> list[int]:
        """The cells on the path to a reachable cell, without the source.

        Raises:
            ValueError: no path leads there.
        """
        w = self._window
        way = _search.path(self._lengths_m, w.cols, w.geometry.resolution_m, w.index(cell))
        cells: list[int] = w.cells(np.array(way, np.int64)).tolist()
        return cells

    def follow(self, grid: NDArray[np.int8], changed: NDArray[np.int64]) -> bool:
        """Take changes of the map into an unlimited search, as if it were made anew; False if it has to be.

        Cells that became free only make paths shorter: the search goes on from what is reached beside them. A new one
        is due if a reached cell is free no more, or a free one lies outside the window.
        """
        w = self._window
        indices = w.indices(changed)
        free = grid[changed] == FREE
        if (self._lengths_m[indices[~free]] < math.inf).any() or not w.inside(indices[free]).all():
            return False
        steps = np.array([down * w.cols + right for down in (-1, 0, 1) for right in (-1, 0, 1)])
        beside = np.unique(indices[free][:, None] + steps)
        reached = beside[self._lengths_m[beside] < math.inf]
        self.search(grid, reached[np.argsort(self._lengths_m[reached], kind="stable")])
        return True

    def search(
        self, grid: NDArray[np.int8], seeds: NDArray[np.int64], limit_m: float = math.inf, until: int = -1
    ) -> None:
        """Search on from indices within the window, in the order of their lengths."""
        w = self._window
        _search.lengthen(w.cut(grid), w.cols, w.geometry.resolution_m, seeds, limit_m, until, self._lengths_m)
        self._blocks = None


def reach_over(states: NDArray[np.int8], geometry: GridGeometry, source: int) -> Reach:
    """Shortest paths over the free cells of a map, from one of them."""
    window = Window(geometry, (0, geometry.rows), (0, geometry.cols))
    reach = Reach(source, window)
    reach.search(states, np.array([window.index(source)], np.int64))
    return reach


class Planner:
    """Searches one map."""

    def __init__(self, own_map: OwnMap, found: Found | None = None) -> None:
        """`found`: bodies around which paths lead; they are no part of the map."""
        self._map = own_map
        self._found = found
        self.led_aside = False
        """Whether others led the robot off its path in the last tick, or held it up."""
        self._known = np.zeros(own_map.geometry.size, np.uint8)
        self._discovered: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        """Cells in the order in which they became known as free."""
        self._seen = 0
        """Mark of the map's changes that are in `_discovered` (`OwnMap.changes`)."""
        self._box = own_map.geometry.rows, 0, own_map.geometry.cols, 0
        """First row, row after the last, first and after the last column of a part of the grid that holds them all."""

    def nearest_free(self, cell: int) -> int:
        """`cell` itself if it is known free, else the nearest cell that is; of several the one that became known first.

        It is `cell`, too, if no cell is known free, as after a peer's lie.

        Cells that became known between two calls count in the order of their index.
        """
        self._discover()
        if self._map.cells[cell] == FREE:
            return cell
        discovered = np.concatenate(self._discovered)
        self._discovered = [discovered]
        free = discovered[self._map.cells[discovered] == FREE]
        if not free.size:
            return cell
        cols = self._map.geometry.cols
        row, col = divmod(cell, cols)
        rows_of, cols_of = np.divmod(free, cols)
        return int(free[int(np.argmin((rows_of - row) ** 2 + (cols_of - col) ** 2))])

    def reach(self, source: int, limit_m: float = math.inf, *, around: bool = True) -> Reach:
        """Shortest paths from a known free cell; cells farther than `limit_m` count as unreachable.

        `around`: not through bodies found, which are there for a while only.
        """
        return self._search(source, limit_m, -1, around=around)

    def path(self, source: int, cell: int) -> list[int]:
        """The cells on the shortest path between two known free cells, without the first; none if there is no path."""
        reach = self._search(source, math.inf, cell)
        return reach.path(cell) if reach.length_m(cell) < math.inf else []

    def length_m(self, source: int, cell: int, limit_m: float) -> float:
        """Length of the shortest path between two known free cells; infinite if none is so short."""
        return self._search(source, limit_m, cell).length_m(cell)

    def clear_line(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether every cell on a segment is known free, and no body found stands in its way."""
        return self._map.clear_line(*a, *b) and (not self._found or self._found.clear(a, b))

    def _cells(self) -> NDArray[np.int8]:
        """The map; where bodies found stand, a copy with these as walls."""
        if not self._found:
            return self._map.cells
        cells = self._map.cells.copy()
        cells[self._found.cells()] = OCCUPIED
        return cells

    def _discover(self) -> None:
        changed, self._seen = self._map.changes(self._seen)
        if not changed.size:
            return
        new = _floor.newly_free(changed, self._map.cells, self._known)
        if new.size:
            new.sort()
            self._discovered.append(new)
            rows, cols = np.divmod(new, self._map.geometry.cols)
            self._box = self._around(int(rows[0]), int(rows[-1]), int(cols.min()), int(cols.max()))

    def _around(self, low_row: int, high_row: int, low_col: int, high_col: int) -> tuple[int, int, int, int]:
        """The box, grown in steps to hold some rows and columns too."""
        g, (row, end_row, col, end_col) = self._map.geometry, self._box
        return (
            min(row, low_row // _BOX_STEP * _BOX_STEP),
            max(end_row, min((high_row // _BOX_STEP + 1) * _BOX_STEP, g.rows)),
            min(col, low_col // _BOX_STEP * _BOX_STEP),
            max(end_col, min((high_col // _BOX_STEP + 1) * _BOX_STEP, g.cols)),
        )

    def _search(self, source: int, limit_m: float, until: int, *, around: bool = True) -> Reach:
        """Shortest paths; with a cell `until` >= 0 only the lengths on those to it are sure."""
        self._discover()
        g = self._map.geometry
        row, col = divmod(source, g.cols)
        rows, end_row, cols, end_col = self._around(row, row, col, col)
        if limit_m < math.inf:
            far = math.ceil(limit_m / g.resolution_m) + 1
            rows, end_row, cols, end_col = (
                max(rows, row - far),
                min(end_row, row + far),
                max(cols, col - far),
                min(end_col, col + far),
            )
        window = Window(g, (rows, end_row), (cols, end_col))
        reach = Reach(source, window)
        reach.search(
            self._cells() if around else self._map.cells,
            np.array([window.index(source)], np.int64),
            limit_m,
            -1 if until < 0 else window.index(until),
        )
        return reach
