"""DSDV (Perkins & Bhagwat 1994) as every node runs it, the MS too: absorb updates, expire neighbors, advertise.

A destination issues even sequence numbers for itself, here 2 x tick, so that they rise across a restart as well. The
whole table is broadcast at every tick (paper, III). All updates of a tick are merged at once, so that the order of
their arrival cannot matter.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np

from agents.config import RobotConfig
from agents.forwarding_table import ForwardingTable, check_rows, freshness_of
from agents.messages import ROW, Table, Update
from agents.neighbors import Neighbors
from agents.nms import MsRoute
from agents.srrc import CLS_BIT
from bus.codec import WireError
from medium.messages import Reception
from world.messages import NOBODY, STATION, Cls


class Router:
    """One DSDV node."""

    def __init__(self, config: RobotConfig, rng: random.Random, quiet_until: int) -> None:
        self.node = config.node
        self.table = ForwardingTable(config.node)
        self.neighbors = Neighbors(config)
        self.ms = MsRoute(config, self.table, self.neighbors)
        self._rng = rng
        # The MS is where everybody knows it to be, and no search robot.
        self.table.set_inherent(STATION, Cls.RR, config.station_m, config.station_m)
        self._sticky = STATION if config.policy.routing.sticky else NOBODY
        self.quiet_until = quiet_until
        """First tick at which a new incarnation sends and learns routes again."""
        self.bad_frames = 0

    def step(self, tick: int, updates: Sequence[Reception]) -> None:
        """Take in the updates heard at a tick, ordered by source; then the routes are those of this tick."""
        if tick < self.quiet_until:
            return
        self._absorb(tick, updates)
        for gone in self.neighbors.expire(tick):
            self.table.break_via(gone)
        if self.node != STATION:
            self.ms.step(tick, self._rng)

    def _absorb(self, tick: int, receptions: Sequence[Reception]) -> None:
        updates = [(r, update) for r in receptions if (update := self._decoded(r)) is not None]
        if not updates:
            return
        batch = np.frombuffer(b"".join([update.rows.data for _, update in updates]), ROW)
        try:
            check_rows(batch)
        except WireError:
            self._absorb(tick, [r for r, update in updates if self._acceptable(update)])
            return
        counts = [len(update.rows) for _, update in updates]
        # Rows ascend by destination, so the entry for the MS, node 0, is the first of a table that has one.
        heads = batch[np.cumsum([0, *counts[:-1]])]
        ms_freshness = np.where(heads["dst"] == STATION, heads["freshness"], -1).tolist()
        for (reception, update), freshness in zip(updates, ms_freshness, strict=True):
            neighbor = self.neighbors.hear(reception.src, tick, reception.rx_power_dbm)
            neighbor.nms, neighbor.hold, neighbor.map_version = update.nms, update.hold, update.map_version
            neighbor.acks, neighbor.ms_freshness = update.acks, freshness
        self.table.merge(np.array([r.src for r, _ in updates]), counts, batch, sticky=self._sticky)

    def _decoded(self, reception: Reception) -> Update | None:
        try:
            return Update.decode(reception.payload)
        except WireError:
            self.bad_frames += 1
            return None

    def _acceptable(self, update: Update) -> bool:
        try:
            check_rows(update.rows)
        except WireError:
            self.bad_frames += 1
            return False
        return True

    def announce_self(self, tick: int, at_m: tuple[float, float], flags: int, target_m: tuple[float, float]) -> None:
        """Renew this node's own entry: a newer even number, where it is, its class and its target."""
        self.table.set_route(self.node, freshness_of(2 * tick, 0), self.node)
        self.table.set_inherent(self.node, flags, at_m, target_m)

    def shown(self, tick: int, msr: int) -> Table:
        """The table with every column of Fig. 2, for the recording."""
        table = self.table
        ids = table.known[table.known != self.node]
        return Table(
            tick,
            self.node,
            msr,
            ids.astype(np.int16),
            table.next_hop[ids],
            table.hops(ids),
            table.rows["place_m"][ids, :2],
            np.isin(ids, self.neighbors.naming(self.node)).astype(np.uint8),
            (table.flags[ids] & CLS_BIT).astype(np.uint8),
        )
