"""Whom a node hears: one record per neighbor, with its distance by received power."""

from __future__ import annotations

import math
from dataclasses import dataclass

from agents.config import MOST_DECADES, RobotConfig
from agents.forwarding_table import hop_of
from world.terms import NOBODY, TICK_S


@dataclass(slots=True)
class Neighbor:
    """When and how loud a neighbor was heard, and the parts of its last update that are for neighbors only."""

    node: int
    heard_tick: int = -1
    rx_power_dbm: float = 0.0
    """Smoothed, if the configuration says so."""
    distance_m: float = math.inf
    """From received power [paper 5.3, 5.4]."""
    nms: int = NOBODY
    hold: int = NOBODY
    map_version: int = 0
    ms_freshness: int = -1
    """Freshness of its own entry for the MS (agents/forwarding_table.py)."""
    acks: bytes = b""
    acks_version: int = 0
    ahead: bytes = b""

    @property
    def ms_seqno(self) -> int:
        """Sequence number of its entry for the MS; -1 if it has none."""
        return self.ms_freshness >> 8

    @property
    def ms_hop(self) -> int:
        """Its hop count to the MS."""
        return hop_of(self.ms_freshness)


class Neighbors:
    """All neighbors heard within the time-out, by id."""

    def __init__(self, config: RobotConfig) -> None:
        self._config = config
        routing = config.rules.routing
        self._timeout_ticks = routing.neighbor_timeout_ticks
        self._silence_ticks = routing.silence_ticks
        self._at_1m_dbm = config.tx_power_dbm - config.loss_1m_db
        self._slope_db = 10.0 * config.exponent
        tau_s = config.power_smoothing_s
        self._weight = 1.0 if tau_s == 0.0 else 1.0 - math.exp(-TICK_S / tau_s)
        self.by_id: dict[int, Neighbor] = {}

    def hear(self, node: int, tick: int, rx_power_dbm: float) -> Neighbor:
        """Note that a frame of `node` arrived; returns the neighbor's record."""
        neighbor = self.by_id.get(node)
        if neighbor is None:
            neighbor = self.by_id[node] = Neighbor(node, rx_power_dbm=rx_power_dbm)
        neighbor.heard_tick = tick
        power_dbm = neighbor.rx_power_dbm + self._weight * (rx_power_dbm - neighbor.rx_power_dbm)
        neighbor.rx_power_dbm = power_dbm
        decades = (self._at_1m_dbm - power_dbm) / self._slope_db
        neighbor.distance_m = 10.0 ** min(decades, MOST_DECADES)
        return neighbor

    def expire(self, tick: int) -> list[int]:
        """Forget neighbors that were silent for the time-out [paper 2.8]; returns their ids, ascending."""
        limit = tick - self._timeout_ticks
        gone = sorted([node for node, n in self.by_id.items() if n.heard_tick <= limit])
        for node in gone:
            del self.by_id[node]
        return gone

    def silent(self, node: int, tick: int) -> bool:
        """Whether no power arrives from `node`: unknown, or not heard for the silence limit (rule A [paper 3.7])."""
        neighbor = self.by_id.get(node)
        return neighbor is None or tick - neighbor.heard_tick >= self._silence_ticks

    def distance_m(self, node: int, tick: int) -> float:
        """Distance from received power; infinite for a silent neighbor."""
        return math.inf if self.silent(node, tick) else self.by_id[node].distance_m

    def naming(self, node: int) -> list[int]:
        """The inv of `node`: the neighbors whose NMS it is, ascending [paper 2.2, 2.3]."""
        return sorted([n.node for n in self.by_id.values() if n.nms == node])
