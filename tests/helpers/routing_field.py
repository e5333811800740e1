"""Random moving nodes that run the real `Router`, joined by a fake radio: restarts, pauses and frame loss included."""

from __future__ import annotations

import math
import random
from collections import deque

from agents.config import RobotConfig
from agents.dsdv import Router
from agents.messages import Update
from medium.messages import Reception
from world.grid import GridGeometry
from world.terms import NOBODY, STATION, Cls

RADIUS_M = 10.0


def router_config(node: int, seed: int = 0, radius_m: float = RADIUS_M) -> RobotConfig:
    return RobotConfig(
        node, seed, GridGeometry(4, 4), (0.0, 0.0), (0.0, 0.0, 1.0, 1.0), radius_m, 8.0, 180, 0.0, 40.0, 3.0
    )


def power_dbm(distance_m: float) -> float:
    """The inverse of what a robot does with power."""
    return -40.0 - 30.0 * math.log10(max(distance_m, 0.01))


class Field:
    """Node 0 is the MS and stays; the others move, pause and restart."""

    def __init__(self, nodes: int, rng: random.Random, *, loss: float = 0.0, side_m: float = 25.0) -> None:
        self.rng = rng
        self.loss = loss
        self.side_m = side_m
        self.tick = 0
        self.places = {k: (rng.uniform(0, side_m), rng.uniform(0, side_m)) for k in range(nodes)}
        self.incarnation = dict.fromkeys(range(nodes), 0)
        self.paused_until = dict.fromkeys(range(nodes), 0)
        self.routers = {k: self._router(k) for k in range(nodes)}
        self.inboxes: dict[int, list[Reception]] = {k: [] for k in range(nodes)}

    def _router(self, node: int) -> Router:
        incarnation = self.incarnation[node]
        quiet_until = self.tick + 11 if incarnation else self.tick
        rng = random.Random(f"{self.rng.random()}/{node}/{incarnation}")
        return Router(router_config(node), rng, quiet_until)

    @property
    def present(self) -> list[int]:
        return [k for k in self.routers if self.paused_until[k] <= self.tick]

    def linked(self, a: int, b: int) -> bool:
        return a != b and math.dist(self.places[a], self.places[b]) <= RADIUS_M

    def move(self, step_m: float) -> None:
        for k in self.present:
            if k != STATION:
                x, y = self.places[k]
                dx, dy = self.rng.uniform(-step_m, step_m), self.rng.uniform(-step_m, step_m)
                self.places[k] = min(max(x + dx, 0.0), self.side_m), min(max(y + dy, 0.0), self.side_m)

    def restart(self, node: int) -> None:
        self.incarnation[node] += 1
        self.routers[node] = self._router(node)
        self.inboxes[node] = []

    def pause(self, node: int, ticks: int) -> None:
        self.paused_until[node] = self.tick + ticks

    def step(self) -> None:
        """One tick: everybody present absorbs, announces itself, and is heard at the next tick."""
        heard: dict[int, list[Reception]] = {k: [] for k in self.routers}
        present = self.present
        for k in present:
            router = self.routers[k]
            router.step(self.tick, self.inboxes[k])
            router.table.check_invariants()
            router.announce_self(self.tick, self.places[k], Cls.SR, self.places[k])
            if self.tick < router.quiet_until:
                continue
            update = Update(router.ms.nms, NOBODY, 0, router.table.advertised(), b"").encode()
            for other in present:
                if self.linked(k, other) and self.rng.random() >= self.loss:
                    heard[other].append((k, power_dbm(math.dist(self.places[k], self.places[other])), update))
        # What a paused node would have heard is lost.
        self.inboxes = heard
        self.tick += 1

    def next_hop(self, node: int, dst: int) -> int:
        return self.routers[node].table.next_hop_to(dst)

    def loops(self) -> list[tuple[int, int]]:
        """(node, destination) from which following next hops of present nodes returns to a node."""
        found = []
        present = set(self.present)
        for dst in self.routers:
            for node in present - {dst}:
                seen, here = {node}, self.next_hop(node, dst)
                while here != NOBODY and here != dst and here in present:
                    if here in seen:
                        found.append((node, dst))
                        break
                    seen.add(here)
                    here = self.next_hop(here, dst)
        return found

    def true_hops(self, source: int) -> dict[int, int]:
        """Breadth-first search over the present nodes: the oracle."""
        hops = {source: 0}
        queue = deque([source])
        while queue:
            here = queue.popleft()
            for other in self.present:
                if other not in hops and self.linked(here, other):
                    hops[other] = hops[here] + 1
                    queue.append(other)
        return hops

    def path_to_ms(self, node: int) -> list[int] | None:
        """The nodes on the way to the MS if every next hop is a living link, else None."""
        path = [node]
        while path[-1] != STATION:
            nxt = self.next_hop(path[-1], STATION)
            if nxt == NOBODY or nxt in path or nxt not in self.present or not self.linked(path[-1], nxt):
                return None
            path.append(nxt)
        return path

    def hop(self, node: int, dst: int) -> int:
        return self.routers[node].table.hop(dst)
