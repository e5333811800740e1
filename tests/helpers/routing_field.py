"""Random moving nodes that run the real `Router`, joined by a fake radio: restarts, pauses and frame loss included."""

from __future__ import annotations

import math
import random
from collections import deque

from agents.config import RobotConfig
from agents.dsdv import Router
from agents.messages import Update
from medium.messages import Reception
from tests.oracles.forwarding_table import check_invariants
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


Entries = dict[int, dict[int, tuple[int, int]]]
"""(freshness, next hop) by destination, of each node"""


def entries_of(routers: dict[int, Router], tick: int) -> Entries:
    """Tables of those who took part in `tick`; a new incarnation that is still silent passes nothing on."""
    tables = {node: router.table for node, router in routers.items() if tick >= router.quiet_until}
    return {k: {dst: (t.freshness(dst), t.next_hop_to(dst)) for dst in t.known} for k, t in tables.items()}


def stale_hops(before: Entries, after: Entries) -> list[tuple[int, int]]:
    """(node, destination) of each frame that a next hop would pass on by an entry no fresher than the sender's.

    A frame that is sent in a tick (`before`) is passed on in the next one (`after`), if the next hop takes part.
    """
    return [
        (node, dst)
        for node, table in before.items()
        for dst, (freshness, next_hop) in table.items()
        if next_hop in after and after[next_hop].get(dst, (-1, NOBODY))[0] <= freshness
    ]


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
        self.taking_part: list[int] = []
        """Who took part in the last tick. Only they passed frames on, so nobody else is on a frame's way."""
        self.inboxes: dict[int, list[Reception]] = {k: [] for k in range(nodes)}

    def _router(self, node: int) -> Router:
        incarnation = self.incarnation[node]
        config = router_config(node)
        rng = random.Random(f"{self.rng.random()}/{node}/{incarnation}")
        return Router(config, rng, config.rules.routing.quiet_until(incarnation, self.tick))

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
        """Pause a node from the next tick on. It still takes the step of that tick, unheard, like a stopped process."""
        if node in self.present:
            self._take_step(node)
        self.paused_until[node] = self.tick + ticks

    def _take_step(self, node: int) -> None:
        router = self.routers[node]
        router.step(self.tick, self.inboxes[node])
        check_invariants(router.table)
        router.announce_self(self.tick, self.places[node], Cls.SR, self.places[node])

    def step(self) -> None:
        """One tick: each present node absorbs updates and announces itself, to be heard at the next tick."""
        heard: dict[int, list[Reception]] = {k: [] for k in self.routers}
        present = self.taking_part = self.present
        for k in present:
            self._take_step(k)
            router = self.routers[k]
            if self.tick < router.quiet_until:
                continue
            update = Update(router.ms.nms, NOBODY, 0, router.table.advertised(), b"").encode()
            for other in present:
                if self.linked(k, other) and self.rng.random() >= self.loss:
                    heard[other].append((k, power_dbm(math.dist(self.places[k], self.places[other])), update))
        # Frames to a paused node are lost.
        self.inboxes = heard
        self.tick += 1

    def next_hop(self, node: int, dst: int) -> int:
        return self.routers[node].table.next_hop_to(dst)

    def entries(self) -> Entries:
        return entries_of({k: self.routers[k] for k in self.taking_part}, self.tick - 1)

    def loops(self) -> list[tuple[int, int]]:
        """(node, destination) from which following next hops of who took part returns to a node."""
        found = []
        taking_part = set(self.taking_part)
        for dst in self.routers:
            for node in taking_part - {dst}:
                seen, here = {node}, self.next_hop(node, dst)
                while here != NOBODY and here != dst and here in taking_part:
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
