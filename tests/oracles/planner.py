"""Shortest paths by SciPy over a graph of free cells: the oracle of agents/_search.pyx."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from agents.own_map import OwnMap
from world.grid import FREE


def lengths_m(own_map: OwnMap, source: int, limit_m: float = math.inf) -> NDArray[np.float64]:
    """As agents.planner.Planner.reach: (cells,) path lengths."""
    g = own_map.geometry
    free = (own_map.cells == FREE).reshape(g.rows, g.cols)
    numbers = np.arange(g.size).reshape(g.rows, g.cols)
    starts, ends, costs_m = [], [], []
    for d_row, d_col in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows = slice(0, g.rows - d_row), slice(d_row, g.rows)
        cols = (slice(0, g.cols - 1), slice(1, g.cols)) if d_col == 1 else (slice(1, g.cols), slice(0, g.cols - 1))
        if d_col == 0:
            cols = slice(0, g.cols), slice(0, g.cols)
        open_ = free[rows[0], cols[0]] & free[rows[1], cols[1]]
        if d_row and d_col:  # a diagonal step passes between two cells
            open_ = open_ & free[rows[0], cols[1]] & free[rows[1], cols[0]]
        starts.append(numbers[rows[0], cols[0]][open_])
        ends.append(numbers[rows[1], cols[1]][open_])
        step_m = g.resolution_m * math.sqrt(2.0) if d_row and d_col else g.resolution_m
        costs_m.append(np.full(len(starts[-1]), step_m))
    graph = csr_array((np.concatenate(costs_m), (np.concatenate(starts), np.concatenate(ends))), shape=(g.size, g.size))
    lengths: NDArray[np.float64] = dijkstra(graph, directed=False, indices=source, limit=limit_m)
    return lengths


def path(own_map: OwnMap, lengths: NDArray[np.float64], cell: int) -> list[int]:
    """As agents.planner.Reach.path."""
    g = own_map.geometry
    steps = []
    while lengths[cell] > 0.0:
        steps.append(cell)
        cell = _before(g.rows, g.cols, g.resolution_m, lengths, cell)
    return steps[::-1]


def _before(rows: int, cols: int, resolution_m: float, lengths: NDArray[np.float64], cell: int) -> int:
    row, col = divmod(cell, cols)
    best = cell
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(col - 1, 0), min(col + 2, cols)):
            step_m = resolution_m
            if r != row and c != col:
                if math.isinf(lengths[row * cols + c]) or math.isinf(lengths[r * cols + col]):
                    continue
                step_m *= math.sqrt(2.0)
            other = r * cols + c
            if lengths[other] + step_m == lengths[cell] and lengths[other] < lengths[best]:
                best = other
    assert best != cell, "no path leads there"
    return best


def length_near_m(own_map: OwnMap, lengths: NDArray[np.float64], x_m: float, y_m: float) -> float:
    """As agents.planner.Reach.length_near_m."""
    cells = np.flatnonzero(lengths < math.inf)
    centers = own_map.geometry.centers(cells)
    gaps = np.hypot(centers[:, 0] - x_m, centers[:, 1] - y_m)
    nearest = int(np.argmin(gaps))
    return float(lengths[cells[nearest]] + gaps[nearest])
