"""What a snapshot says of the routes to the MS: who has one, who is farthest from it, and the chain of NMS pointers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from world.feed import Snapshot
from world.terms import NOBODY, STATION, UNREACHABLE, Cls

__all__ = ["chain_from", "chain_to_station", "connected", "farthest_search_robots", "hop_summary"]


def connected(snapshot: Snapshot) -> NDArray[np.bool_]:
    """Robots, shape (n,), that take part and have a finite route to the MS. These and no others have an NMS."""
    return np.asarray((snapshot.present == 1) & (snapshot.hops < UNREACHABLE))


def hop_summary(snapshot: Snapshot) -> tuple[int, int, float]:
    """How many robots are connected, the most hops and the mean hops; zeros if none is."""
    hops = snapshot.hops[connected(snapshot)]
    return (len(hops), int(hops.max()), float(hops.mean())) if len(hops) else (0, 0, 0.0)


def farthest_search_robots(snapshot: Snapshot, station_m: tuple[float, float]) -> list[int]:
    """Search robots with a route: most hops first, then farthest from the MS, then by id."""
    rows = np.flatnonzero(connected(snapshot) & (snapshot.cls == Cls.SR))
    nodes, hops = snapshot.nodes[rows], snapshot.hops[rows].astype(np.int64)
    distance_m = np.hypot(*(snapshot.xy_m[rows] - station_m).T)
    order: list[int] = nodes[np.lexsort((nodes, -distance_m, -hops))].tolist()
    return order


def chain_from(robot: int, snapshot: Snapshot) -> list[int]:
    """Nodes from `robot` along the NMS pointers, the MS last if they lead there.

    The chain ends early where a pointer leads to nobody, to a robot that takes no part, or back into the chain. The MS
    counts, whatever its state.
    """
    nms, present = snapshot.nms, snapshot.present
    chain: list[int] = []
    node = robot
    while node != STATION:
        if node == NOBODY or node in chain or not present[node - 1]:
            return chain
        chain.append(node)
        node = int(nms[node - 1])
    chain.append(STATION)
    return chain


def chain_to_station(robot: int, snapshot: Snapshot) -> list[int]:
    """Nodes from `robot` to the MS along the NMS pointers, both included; empty if the pointers do not lead there."""
    chain = chain_from(robot, snapshot)
    return chain if chain and chain[-1] == STATION else []
