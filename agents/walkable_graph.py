"""The walkable graph of one map as SciPy's shortest paths want it, where there is no compiled search.

The graph has a node per free cell and edges to its eight neighbors; a diagonal step needs both cells that it passes
between. Nodes are appended as cells become known, so that a changed map costs what changed.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from agents.own_map import OwnMap
from world.grid import FREE

_NO_NODE: Final = -1
_STEPS: Final = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_SIDES: Final = ((4, 0, 2), (5, 1, 2), (6, 0, 3), (7, 1, 3))
"""A diagonal step, and the two straight steps whose cells must be free as well."""


class WalkableGraph:
    """Nodes and edges, as of the last `update`."""

    def __init__(self, own_map: OwnMap) -> None:
        self._map = own_map
        g = own_map.geometry
        self._cols = g.cols
        # A rim of cells that are never free spares every bounds check.
        self._width = g.cols + 2
        self._offsets = np.array([dr * self._width + dc for dr, dc in _STEPS])
        straight, diagonal = g.resolution_m, g.resolution_m * math.sqrt(2.0)
        self._weights = np.array([straight] * 4 + [diagonal] * 4)
        self._padded_node = np.full((g.rows + 2) * self._width, _NO_NODE, np.int32)
        self._mark = np.zeros(len(self._padded_node), bool)
        self._node_of = np.full(g.size, _NO_NODE, np.int32)
        self.cells: NDArray[np.int64] = np.zeros(0, np.int64)
        """The cells of the nodes, in the order in which they became known as free; some are walls by now."""
        self._ends: NDArray[np.int32] = np.zeros((0, 8), np.int32)
        self._cost_m: NDArray[np.float64] = np.zeros((0, 8))
        self._seen = 0
        """Changes of the map that are in the graph."""

    def lengths_m(self, source: int, limit_m: float) -> NDArray[np.float64]:
        """Path length from a known free cell to every cell; infinite beyond `limit_m` and where no path leads."""
        n = len(self.cells)
        indptr = np.arange(0, 8 * n + 1, 8, dtype=np.int32)
        graph = csr_array((self._cost_m.ravel(), self._ends.ravel(), indptr), shape=(n, n))
        lengths = np.full(len(self._node_of), math.inf)
        lengths[self.cells] = dijkstra(graph, indices=int(self._node_of[source]), limit=limit_m)
        return lengths

    def _padded(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        rows, cols = np.divmod(cells, self._cols)
        return (rows + 1) * self._width + cols + 1

    def _sorted(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Cells in ascending order, each once: for a few of them in a small range faster than `np.unique`."""
        if not cells.size:
            return cells
        self._mark[cells] = True
        first = int(cells.min())
        ordered = np.flatnonzero(self._mark[first : int(cells.max()) + 1]) + first
        self._mark[ordered] = False
        return ordered

    def update(self) -> None:
        """Take in what has changed in the map: before every question."""
        changed, self._seen = self._map.changes(self._seen)
        if not changed.size:
            return
        free = self._map.cells[changed] == FREE
        known = self._node_of[changed] != _NO_NODE
        # Each once.
        new = self._sorted(changed[free & ~known])
        # A cell that turned out to be a wall keeps its node, without edges to or from it.
        lost = self._sorted(changed[~free & known])
        lost = lost[self._padded_node[self._padded(lost)] != _NO_NODE]
        if not new.size and not lost.size:
            return
        first = len(self.cells)
        nodes = np.arange(first, first + len(new), dtype=np.int32)
        self._node_of[new] = nodes
        self._padded_node[self._padded(new)] = nodes
        self._padded_node[self._padded(lost)] = _NO_NODE
        self.cells = np.concatenate((self.cells, new))
        self._ends = np.concatenate((self._ends, np.zeros((len(new), 8), np.int32)))
        self._cost_m = np.concatenate((self._cost_m, np.zeros((len(new), 8))))
        self._link(np.concatenate((new, lost)))

    def _link(self, changed: NDArray[np.int64]) -> None:
        """Renew the edges of the nodes at and around changed cells."""
        centers = self._padded(changed)
        around = self._sorted(np.concatenate((centers, (centers[:, None] + self._offsets).ravel())))
        around = around[self._padded_node[around] != _NO_NODE]
        nodes = self._padded_node[around]
        ends = self._padded_node[around[:, None] + self._offsets]
        passable = ends != _NO_NODE
        for diagonal, a, b in _SIDES:
            passable[:, diagonal] &= passable[:, a] & passable[:, b]
        # Every node keeps eight edges; one that leads nowhere is a loop to itself, which no search can use.
        self._ends[nodes] = np.where(passable, ends, nodes[:, None])
        self._cost_m[nodes] = self._weights
        gone = self._node_of[changed[self._padded_node[centers] == _NO_NODE]]
        self._ends[gone] = gone[:, None]
        self._cost_m[gone] = self._weights
