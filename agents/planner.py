"""Shortest paths over the known free cells of a robot's own map.

A step leads to one of eight neighboring cells. A diagonal step needs both cells that it passes between.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents import _cells, _search
from agents.own_map import OwnMap
from world.grid import FREE, GridGeometry


class Reach:
    """Path lengths from one cell to all others that can be reached over known free cells.

    Shortest path lengths are unique, paths are not. Of two cells that a path may come from, it comes from the one
    nearer to the source, and of two that are as near from the one with the lower index.
    """

    def __init__(self, geometry: GridGeometry, lengths_m: NDArray[np.float64]) -> None:
        self._geometry = geometry
        self._lengths_m = lengths_m

    def length_m(self, cell: int) -> float:
        """Path length to a cell; infinite if no path led there at the time of the search."""
        return float(self._lengths_m[cell])

    def lengths_m(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Path lengths to many cells, shape (n,)."""
        lengths: NDArray[np.float64] = self._lengths_m[cells]
        return lengths

    def reached(self) -> NDArray[np.int64]:
        """All cells that can be reached, ascending."""
        return np.flatnonzero(self._lengths_m < math.inf)

    def length_near_m(self, x_m: float, y_m: float) -> float:
        """Path length to the reached cell whose center is nearest to a place, plus the straight line from there."""
        g = self._geometry
        return _search.length_near(
            self._lengths_m, g.rows, g.cols, g.resolution_m, g.x0_m, g.y0_m, x_m, y_m, g.index(x_m, y_m)
        )

    def path(self, cell: int) -> list[int]:
        """The cells on the path to a reachable cell, without the source.

        Raises:
            ValueError: no path leads there.
        """
        g = self._geometry
        return _search.path(self._lengths_m, g.rows, g.cols, g.resolution_m, cell)


def reach_over(states: NDArray[np.int8], geometry: GridGeometry, source: int) -> Reach:
    """Shortest paths over the free cells of a map, from one of them."""
    return Reach(geometry, _search.lengths(states, geometry.cols, geometry.resolution_m, source, math.inf, -1))


class Planner:
    """Searches one map."""

    def __init__(self, own_map: OwnMap) -> None:
        self._map = own_map
        self._known = np.zeros(own_map.geometry.size, np.uint8)
        self._discovered: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        """Cells in the order in which they became known as free."""
        self._seen = 0
        """Mark of the map's changes that are in `_discovered` (`OwnMap.changes`)."""

    def nearest_free(self, cell: int) -> int:
        """`cell` itself if it is known free, else the nearest cell that is; of several the one that became known first.

        If no cell is known free, as after a lie of a peer's, it is `cell` too.

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

    def reach(self, source: int, limit_m: float = math.inf) -> Reach:
        """Shortest paths from a known free cell; cells farther than `limit_m` count as unreachable."""
        return self._search(source, limit_m, -1)

    def path(self, source: int, cell: int) -> list[int]:
        """The cells on the shortest path between two known free cells, without the first; none if there is no path."""
        reach = self._search(source, math.inf, cell)
        return reach.path(cell) if reach.length_m(cell) < math.inf else []

    def _discover(self) -> None:
        changed, self._seen = self._map.changes(self._seen)
        if not changed.size:
            return
        new = _cells.newly_free(changed, self._map.cells, self._known)
        if new.size:
            new.sort()
            self._discovered.append(new)

    def _search(self, source: int, limit_m: float, until: int) -> Reach:
        """Shortest paths. Those longer than the path to the cell `until` may be missing or too long."""
        self._discover()
        g = self._map.geometry
        return Reach(g, _search.lengths(self._map.cells, g.cols, g.resolution_m, source, limit_m, until))
