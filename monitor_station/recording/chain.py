"""The tree of NMS pointers: its links, its longest chain, and a layout of its nodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from world.feed import Snapshot
from world.routes import chain_from, connected, farthest_search_robots
from world.terms import STATION


def parents(snapshot: Snapshot) -> dict[int, int]:
    """Each connected robot's NMS."""
    rows = connected(snapshot)
    return dict(zip(snapshot.nodes[rows].tolist(), snapshot.nms[rows].tolist(), strict=True))


def places(snapshot: Snapshot, nodes: NDArray[np.int16], station_m: tuple[float, float]) -> NDArray[np.float64]:
    """True places of nodes, the station among them, shape (n, 2)."""
    rows = np.minimum(np.searchsorted(snapshot.nodes, nodes), len(snapshot.nodes) - 1)
    xy = snapshot.xy_m[rows]
    xy[nodes == STATION] = station_m
    return xy


def link_strips(snapshot: Snapshot, station_m: tuple[float, float]) -> NDArray[np.float64]:
    """Both ends of every link to an NMS, shape (links, 2, 2)."""
    rows = connected(snapshot)
    return np.stack((snapshot.xy_m[rows], places(snapshot, snapshot.nms[rows], station_m)), axis=1)


def farthest_chain(snapshot: Snapshot, station_m: tuple[float, float]) -> tuple[int, ...]:
    """Nodes from the farthest SR along the NMS pointers (`chain_from`); empty where no SR has a route."""
    ranked = farthest_search_robots(snapshot, station_m)
    return tuple(chain_from(ranked[0], snapshot)) if ranked else ()


def tree_layout(nodes: list[int], nms: Mapping[int, int]) -> NDArray[np.float64]:
    """Layout of `nodes`, the station first, shape (n, 2), in the unit square: depth downwards, leaves side by side.

    Robots without a route to the station are in a row of their own below the tree.
    """
    children: dict[int, list[int]] = {node: [] for node in nodes}
    for child, parent in nms.items():
        children[parent].append(child)
    spots: dict[int, tuple[float, float]] = {}
    width = _lay_out(STATION, children, 0, 0.0, spots)
    strays = [node for node in nodes if node not in spots]
    bottom = 1 + max(depth for _, depth in spots.values())
    for column, node in enumerate(strays):
        spots[node] = ((column + 0.5) * width / len(strays) - 0.5, bottom)
    xy = np.array([spots[node] for node in nodes])
    xy[:, 0] += 0.5
    return np.asarray(xy / (width, max(xy[:, 1].max(), 1.0)))


def _lay_out(
    root: int, children: Mapping[int, list[int]], depth: int, left: float, spots: dict[int, tuple[float, float]]
) -> float:
    """Lay out a subtree from `left` on; returns its right edge."""
    right = left
    for child in children[root]:
        right = _lay_out(child, children, depth + 1, right, spots)
    right = max(right, left + 1)
    spots[root] = ((left + right) / 2 - 0.5, float(depth))
    return right
