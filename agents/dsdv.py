"""DSDV (Perkins & Bhagwat 1994) as every node runs it, the MS too: absorb updates, expire neighbors, advertise.

A destination issues even sequence numbers for itself, here 2 x tick, so that they also rise across a restart. A node
broadcasts its whole table at every tick [paper 2.5, 2.6]. It merges updates in the order of their senders' ids.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np

from agents.config import RobotConfig
from agents.forwarding_table import ForwardingTable, freshness_of
from agents.limits import Limits
from agents.messages import Table
from agents.neighbors import Neighbors
from agents.nms import MsRoute
from bus.codec import WireError
from medium.messages import Reception
from world.terms import NOBODY, STATION, Cls


class Router:
    """One DSDV node."""

    def __init__(self, config: RobotConfig, rng: random.Random, quiet_until: int) -> None:
        self.config = config
        self.node = config.node
        self.limits = Limits(config)
        self.table = ForwardingTable(config.node, config.robots)
        self.neighbors = Neighbors(config)
        self.ms = MsRoute(config, self.table, self.neighbors)
        self._rng = rng
        # Everybody knows where the MS is. It is no search robot.
        self.table.set_inherent(STATION, Cls.RR, config.station_m, config.station_m)
        self._sticky = STATION if config.rules.routing.sticky else NOBODY
        self.quiet_until = quiet_until
        """First tick at which a new incarnation sends and learns routes again."""
        self.inv: list[int] = []
        """Neighbors whose NMS this node is, ascending [paper 2.2, 2.3]."""
        self.bad_frames = 0

    def step(self, tick: int, updates: Sequence[Reception]) -> None:
        """Absorb the updates heard at a tick, ordered by source, and bring all routes up to date."""
        if tick < self.quiet_until:
            return
        self._absorb(tick, updates)
        for gone in self.neighbors.expire(tick):
            self.table.break_via(gone)
        self.inv = self.neighbors.naming(self.node)
        if self.node != STATION:
            self.ms.step(tick, self._rng)

    def _absorb(self, tick: int, updates: Sequence[Reception]) -> None:
        before = self.table.next_hops()
        for src, power, payload in updates:
            try:
                update = self.limits.decode_update(payload, tick)
                ms_freshness = self.table.merge(src, update.rows, before, self._sticky, tick)
            except WireError:
                self.bad_frames += 1
                continue
            neighbor = self.neighbors.hear(src, tick, power)
            neighbor.nms, neighbor.hold, neighbor.map_version = update.nms, update.hold, update.map_version
            if update.acks:  # a neighbor whose radio is limited does not say them in every update
                neighbor.acks, neighbor.acks_version = update.acks, update.acks_version
                neighbor.ahead = update.ahead
            neighbor.ms_freshness = ms_freshness

    def announce_self(
        self, tick: int, at_m: tuple[float, float], cls: int, target_m: tuple[float, float], *, need: bool = False
    ) -> None:
        """Renew this node's own entry: a newer even number, its location, class and target."""
        self.table.set_route(self.node, freshness_of(2 * tick, 0), self.node)
        self.table.set_inherent(self.node, cls, at_m, target_m, need=need)

    def shown(self, tick: int, msr: int) -> Table:
        """The forwarding table with every column of Fig. 2 [paper 2.4], for the recording."""
        table = self.table
        ids = sorted(dst for dst in table.known if dst != self.node)
        return Table(
            tick,
            self.node,
            msr,
            np.array(ids, np.int16),
            np.array([table.next_hop_to(dst) for dst in ids], np.int16),
            np.array([table.hop(dst) for dst in ids], np.uint8),
            np.array([table.location_m(dst) for dst in ids], np.float32).reshape(-1, 2),
            np.array([dst in self.inv for dst in ids], np.uint8),
            np.array([table.cls(dst) for dst in ids], np.uint8),
        )
