"""The forwarding table of the paper's Fig. 2, as columns over node ids.

DSDV elements: dst, next hop, hop count, sequence number. SRRC elements: location, cls; we add the target. How fresh an
entry is, and how short, is one integer, so that Perkins & Bhagwat's rule ("a newer number always replaces, an equal one
only with a smaller metric") is one comparison:

    freshness = seqno * 256 + (255 - hop count), -1 for an unknown destination.

Freshness never falls at any node, and along next hops it never falls either; that is why no loop can arise.
A broken entry (hop count 255, odd number) is kept, not deleted.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.messages import ROW
from bus.codec import WireError
from world.messages import NOBODY, UNREACHABLE

LARGEST_NODE: Final = 4095
"""Highest node id that a table takes: a bound on what a peer can make us store."""

_UNKNOWN: Final = -1


def check_rows(rows: NDArray[np.void]) -> None:
    """Check rows that a neighbor sent.

    Raises:
        WireError: an id is out of bounds, a place not finite, or a metric and its number disagree (odd = infinite).
    """
    places = rows.view("<f4").reshape(len(rows), -1)[:, 2:]
    if not np.isfinite(places).all():
        raise WireError("a place is not finite")
    if (rows["dst"] > LARGEST_NODE).any():
        raise WireError(f"a destination is above {LARGEST_NODE}")
    if ((rows["seqno"] & 1) != (rows["hop"] == UNREACHABLE)).any():
        raise WireError("an odd sequence number is not infinite, or an even one is")


class ForwardingTable:
    """All destinations that node `node` knows; row i of each column belongs to destination i."""

    def __init__(self, node: int) -> None:
        self.node = node
        self._size = 0
        self.rows: NDArray[np.void] = np.zeros(0, ROW)
        """Transmitted elements; valid where `freshness` >= 0."""
        self.next_hop: NDArray[np.int16] = np.zeros(0, np.int16)
        """NOBODY where the metric is infinite."""
        self.freshness: NDArray[np.int64] = np.zeros(0, np.int64)
        self._known: NDArray[np.int64] | None = None
        self._grow(max(node, 15))

    def _grow(self, largest: int) -> None:
        if largest < self._size:
            return
        size = max(largest + 1, 2 * self._size)
        rows = np.zeros(size, ROW)
        rows["dst"] = np.arange(size)
        rows["hop"] = UNREACHABLE
        next_hop = np.full(size, NOBODY, np.int16)
        freshness = np.full(size, _UNKNOWN, np.int64)
        rows[: self._size] = self.rows
        next_hop[: self._size] = self.next_hop
        freshness[: self._size] = self.freshness
        self.rows, self.next_hop, self.freshness, self._size = rows, next_hop, freshness, size

    @property
    def known(self) -> NDArray[np.int64]:
        """Ids of all known destinations, ascending, this node's own among them."""
        if self._known is None:
            self._known = np.flatnonzero(self.freshness >= 0)
        return self._known

    def hop(self, dst: int) -> int:
        """Hop count to a destination; UNREACHABLE if there is no route."""
        return int(self.rows["hop"][dst]) if dst < self._size else UNREACHABLE

    def seqno(self, dst: int) -> int:
        """Sequence number of a destination's entry; -1 if unknown."""
        return int(self.freshness[dst]) >> 8 if dst < self._size else _UNKNOWN

    def location_m(self, dst: int) -> tuple[float, float]:
        """Where a known destination said that it is."""
        row = self.rows[dst]
        return float(row["x_m"]), float(row["y_m"])

    def set_route(self, dst: int, seqno: int, hop: int, next_hop: int) -> None:
        """Write the DSDV elements of one entry; the caller answers for the order of freshness."""
        self._grow(dst)
        if self.freshness[dst] < 0:
            self._known = None
        row = self.rows[dst]
        row["seqno"], row["hop"] = seqno, hop
        self.next_hop[dst] = next_hop if hop < UNREACHABLE else NOBODY
        self.freshness[dst] = seqno * 256 + 255 - hop

    def set_inherent(self, dst: int, x_m: float, y_m: float, cls: int, target_m: tuple[float, float]) -> None:
        """Write the SRRC elements of one entry."""
        self.rows[dst] = (dst, self.rows["hop"][dst], cls, self.rows["seqno"][dst], x_m, y_m, *target_m)

    def merge(
        self, senders: NDArray[np.int64], counts: list[int], rows: NDArray[np.void], *, sticky: int = NOBODY
    ) -> None:
        """Take over what neighbors advertised in one tick.

        Of several neighbors with the same freshest offer the present next hop is kept, else the lowest id wins.

        Args:
            senders: (k,) ids of the neighbors, ascending.
            counts: how many rows each sent.
            rows: their checked rows, one table after the other.
            sticky: a destination whose route is not ours to touch (PROCEDURE 2); its inherent elements are.
        """
        dst = rows["dst"].astype(np.int64)
        self._grow(int(dst.max(initial=0)))
        hop = np.minimum(rows["hop"].astype(np.int64) + 1, UNREACHABLE)
        offered = rows["seqno"].astype(np.int64) * 256 + (UNREACHABLE - hop)
        place = np.repeat(np.arange(len(senders)), counts)
        present = self.next_hop[dst] == senders[place]
        shape = (len(senders), self._size)
        rank = np.full(shape, -1, np.int64)
        rank[place, dst] = 2 * offered + present
        source = np.zeros(shape, np.int64)
        source[place, dst] = np.arange(len(dst))
        best = rank.argmax(0)
        everyone = np.arange(self._size)
        newer = (rank[best, everyone] >> 1) > self.freshness
        newer[self.node] = False
        if sticky != NOBODY:
            newer[sticky] = False
        won = np.flatnonzero(newer)
        if not won.size:
            return
        if (self.freshness[won] < 0).any():
            self._known = None
        taken = source[best[won], won]
        self.rows[won] = rows[taken]
        self.rows["hop"][won] = hop[taken]
        self.freshness[won] = offered[taken]
        self.next_hop[won] = np.where(hop[taken] < UNREACHABLE, senders[best[won]], NOBODY)

    def break_via(self, neighbor: int) -> None:
        """A link is gone: every route through it becomes infinite, with its number + 1 (odd)."""
        broken = np.flatnonzero(self.next_hop == neighbor)
        if not broken.size:
            return
        seqno = self.rows["seqno"][broken] + 1
        self.rows["seqno"][broken] = seqno
        self.rows["hop"][broken] = UNREACHABLE
        self.next_hop[broken] = NOBODY
        self.freshness[broken] = seqno.astype(np.int64) * 256

    def advertised(self) -> NDArray[np.void]:
        """The rows of an update: the whole table, ascending by destination."""
        return self.rows[self.known]

    def check_invariants(self) -> None:
        """Raise AssertionError if the columns contradict one another."""
        known = self.known
        hop, seqno = self.rows["hop"][known].astype(int), self.rows["seqno"][known].astype(int)
        assert ((seqno % 2 == 1) == (hop == UNREACHABLE)).all(), "odd number without infinite metric, or the reverse"
        assert (self.freshness[known] == seqno * 256 + 255 - hop).all(), "freshness differs from number and metric"
        others = known != self.node
        assert ((self.next_hop[known] != NOBODY) == (hop < UNREACHABLE))[others].all(), "a route without a next hop"
