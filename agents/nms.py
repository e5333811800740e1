"""The route to the MS and its next hop, the NMS [paper 3.2].

Plain minimum-hop DSDV chooses links of almost length r_t, and link recovery then pulls robots back. So the MS's entry
is sticky: only the present NMS refreshes it, and only three rules change the NMS:

    a. no route           adopt the best neighbor with a finite route of a newer number [paper 3.3]
    b. link weak          now and then stop refreshing for a while; adopt a potential NMS whose number passes the frozen
                          one [paper 3.4]. A descendant's number never can, so no loop arises.
    c. shortening         adopt a near neighbor whose number is at least ours and that saves a hop [paper 3.5]

`links` says how good a link is: by received power, or as a policy knows better (link_quality.py).

Each change raises the entry's freshness (agents/forwarding_table.py); the proof of freedom from loops needs no more
[paper 3.6].
"""

from __future__ import annotations

import random

from agents.config import RobotConfig
from agents.forwarding_table import ForwardingTable
from agents.link_quality import LinkQuality
from agents.neighbors import Neighbor, Neighbors
from world.terms import NOBODY, STATION, UNREACHABLE


class MsRoute:
    """Keeps entry STATION of a forwarding table."""

    def __init__(self, config: RobotConfig, table: ForwardingTable, neighbors: Neighbors) -> None:
        self._rules = config.rules.routing
        self._table = table
        self._neighbors = neighbors
        self.r_in_m = self._rules.r_in_share * config.radius_m
        self.links = LinkQuality(neighbors, self.r_in_m)
        """How good the links are; a policy may put its own here, before its first step."""
        self._shortcut_m = self._rules.shortcut_share * config.radius_m
        self._frozen_until = -1
        self.acks = b""
        """Acknowledgements of the MS (ACK), as the NMS said them last."""
        self.acks_version = 0
        """The version of the MS's map that contains these reports."""
        self.ahead = b""
        """Acknowledgements beyond gaps (AHEAD), likewise."""

    @property
    def nms(self) -> int:
        """Next hop to the MS, or NOBODY."""
        return self._table.next_hop_to(STATION)

    @property
    def hops(self) -> int:
        """Hop count to the MS."""
        return self._table.hop(STATION)

    @property
    def _seqno(self) -> int:
        return self._table.freshness(STATION) >> 8

    def step(self, tick: int, rng: random.Random) -> None:
        """Refresh or change the route. The tick's updates have been absorbed, and lost neighbors have expired."""
        if self._rules.sticky:
            nms = self.nms
            if nms != NOBODY:
                self._refresh(tick, self._neighbors.by_id[nms])
                nms = self.nms
            if nms == NOBODY:
                self._adopt(self._any_route(tick))
            elif self.links.leaving() or self.links.weak(nms, tick):
                self._probe(tick, rng)
            if self.nms != NOBODY:
                self._adopt(self._shortcut(tick))
        nms = self.nms
        if nms != NOBODY:
            heard = self._neighbors.by_id[nms]
            self.acks, self.acks_version, self.ahead = heard.acks, heard.acks_version, heard.ahead

    def weak(self, tick: int) -> bool:
        """Whether the link to the NMS is weak: rule b applies, and the robot traces its NMS (rule A [paper 3.7])."""
        return self.links.weak(self.nms, tick)

    def _refresh(self, tick: int, nms: Neighbor) -> None:
        """Follow the NMS's own entry; while frozen, only if the NMS has lost its route."""
        newer = nms.ms_seqno > self._seqno
        if newer and (nms.ms_hop == UNREACHABLE or tick > self._frozen_until):
            self._take(nms)

    def _take(self, neighbor: Neighbor) -> None:
        finite = neighbor.ms_hop < UNREACHABLE
        self._table.set_route(STATION, neighbor.ms_freshness - finite, neighbor.node)

    def _adopt(self, neighbor: Neighbor | None) -> None:
        if neighbor is not None:
            self._take(neighbor)
            self._frozen_until = -1

    def _offers(self, tick: int, within_m: float) -> list[Neighbor]:
        """Neighbors that are not silent and have a finite route and another NMS than this node, ascending by id."""
        me = self._table.node
        return [
            n
            for node, n in sorted(self._neighbors.by_id.items())
            if n.ms_hop < UNREACHABLE - 1
            and n.nms != me
            and n.distance_m <= within_m
            and not self._neighbors.silent(node, tick)
        ]

    def _any_route(self, tick: int) -> Neighbor | None:
        """Rule a."""
        seqno = self._seqno
        offers = [n for n in self._offers(tick, float("inf")) if n.ms_seqno > seqno]
        return min(offers, key=lambda n: (n.distance_m > self.r_in_m, n.ms_hop, n.distance_m), default=None)

    def _probe(self, tick: int, rng: random.Random) -> None:
        """Rule b."""
        near_m = self._rules.adopt_share * self.r_in_m
        offers = self._lasting(self._offers(tick, near_m))
        potential = [n for n in offers if n.node != self.nms and n.ms_hop <= self.hops + 1]
        if not potential:
            return
        if tick > self._frozen_until and rng.random() < self._rules.probe_probability:
            self._frozen_until = tick + self._rules.probe_ticks
        if tick <= self._frozen_until:
            seqno = self._seqno
            passed = [n for n in potential if n.ms_seqno > seqno]
            self._adopt(min(passed, key=lambda n: (n.ms_hop, n.distance_m), default=None))

    def _lasting(self, offers: list[Neighbor]) -> list[Neighbor]:
        """Those that stay near where the robot wants to go: rule c must not take back the NMS that rule b just left."""
        return [n for n in offers if self.links.lasting(n.node)]

    def _shortcut(self, tick: int) -> Neighbor | None:
        """Rule c."""
        hops = self.hops
        if hops == 1:
            return None  # nobody saves a hop
        for neighbor in self._neighbors.by_id.values():
            if neighbor.ms_hop + 1 < hops:
                break
        else:
            return None  # the usual case
        seqno = self._seqno
        near = self._lasting(self._offers(tick, self._shortcut_m))
        offers = [
            n
            for n in near
            if n.ms_seqno >= seqno and n.ms_hop + 1 < self.hops and self.links.within(n.node, self._shortcut_m)
        ]
        return min(offers, key=lambda n: (n.ms_hop, n.distance_m), default=None)
