"""DSDV (Perkins & Bhagwat 1994) as every node runs it, the MS too: absorb updates, expire neighbors, advertise.

A destination issues even sequence numbers for itself, here 2 x tick, so that they rise across a restart as well. The
whole table is broadcast at every tick (paper, III). All updates of a tick are merged at once, so that the order of
their arrival cannot matter.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from agents.forwarding_table import ForwardingTable, check_rows
from agents.messages import ACK, ROW, Table
from agents.neighbors import Neighbors
from agents.nms import MsRoute
from bus.codec import WireError, column, integer, unpack
from medium.messages import Reception
from world.messages import MAX_NODE, MAX_TICK, NOBODY, STATION


class Router:
    """One DSDV node."""

    def __init__(self, config: RobotConfig, rng: random.Random, quiet_until: int) -> None:
        self.node = config.node
        self.table = ForwardingTable(config.node)
        self.neighbors = Neighbors(config)
        self.ms = MsRoute(config, self.table, self.neighbors)
        self._rng = rng
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

    def _absorb(self, tick: int, updates: Sequence[Reception]) -> None:
        senders: list[int] = []
        tables: list[bytes] = []
        for src, power, payload in updates:
            try:
                _, nms, hold, version, rows, acks = unpack(payload, 6)
                integer(nms, NOBODY, MAX_NODE)
                integer(hold, NOBODY, MAX_NODE)
                integer(version, 0, MAX_TICK)
                check_rows(column(rows, ROW))
                column(acks, ACK)
            except WireError:
                self.bad_frames += 1
                continue
            neighbor = self.neighbors.hear(src, tick, power)
            neighbor.nms, neighbor.hold, neighbor.map_version, neighbor.acks = nms, hold, version, acks
            senders.append(src)
            tables.append(rows)
        if not senders:
            return
        batch = np.frombuffer(b"".join(tables), ROW)
        counts = [len(rows) // ROW.itemsize for rows in tables]
        ids = np.array(senders)
        self._note_ms(batch, np.repeat(ids, counts))
        self.table.merge(ids, counts, batch, sticky=self._sticky)

    def _note_ms(self, batch: NDArray[np.void], sender: NDArray[np.int64]) -> None:
        """Keep each neighbor's own entry for the MS: the sticky route chooses among them."""
        about_ms = np.flatnonzero(batch["dst"] == STATION)
        if not about_ms.size:
            return
        latest = batch[about_ms[-1]]
        rows = batch[about_ms]
        for node, seqno, hop in zip(
            sender[about_ms].tolist(), rows["seqno"].tolist(), rows["hop"].tolist(), strict=True
        ):
            neighbor = self.neighbors.by_id[node]
            neighbor.ms_seqno, neighbor.ms_hop = seqno, hop
        if self._sticky == STATION and self.node != STATION:
            self.table.set_inherent(STATION, float(latest["x_m"]), float(latest["y_m"]), 0, (0.0, 0.0))

    def announce_self(self, tick: int, x_m: float, y_m: float, cls: int, target_m: tuple[float, float]) -> None:
        """Renew this node's own entry: a newer even number, where it is, its class and its target."""
        self.table.set_route(self.node, 2 * tick, 0, self.node)
        self.table.set_inherent(self.node, x_m, y_m, cls, target_m)

    def shown(self, tick: int, msr: int) -> Table:
        """The table with every column of Fig. 2, for the recording."""
        table = self.table
        ids = table.known[table.known != self.node]
        rows = table.rows[ids]
        return Table(
            tick,
            self.node,
            msr,
            ids.astype(np.int16),
            table.next_hop[ids],
            rows["hop"].copy(),
            np.column_stack((rows["x_m"], rows["y_m"])),
            np.isin(ids, self.neighbors.naming(self.node)).astype(np.uint8),
            rows["cls"] & 1,
        )
