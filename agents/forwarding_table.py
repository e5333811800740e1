"""The forwarding table of the paper's Fig. 2, as columns over node ids.

DSDV elements: dst, next hop, hop count, sequence number. SRRC elements: location, cls; we add the target. How new an
entry is, and how short, is one integer, so that Perkins & Bhagwat's rule ("a newer number always replaces, an equal one
only with a smaller metric") is one comparison:

    freshness = seqno * 256 + (255 - hop count), or -1 for an unknown destination.

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


def freshness_of(seqno: int, hop: int) -> int:
    """One comparable integer of a sequence number and a hop count."""
    return seqno * 256 + UNREACHABLE - hop


def hop_of(freshness: int) -> int:
    """Hop count of an entry; UNREACHABLE for an unknown one."""
    return UNREACHABLE - (freshness & 255) if freshness >= 0 else UNREACHABLE


def check_rows(rows: NDArray[np.void]) -> None:
    """Check rows that neighbors sent.

    Raises:
        WireError: an id is out of bounds, a place not finite, or a metric and its number disagree (odd = infinite).
    """
    freshness = rows["freshness"]
    if rows["dst"].max(initial=0) > LARGEST_NODE or freshness.min(initial=0) < 0:
        raise WireError(f"a destination is above {LARGEST_NODE}, or a sequence number negative")
    if not np.isfinite(rows["place_m"]).all():
        raise WireError("a place is not finite")
    if ((freshness & 256 == 0) != (freshness & 255 > 0)).any():
        raise WireError("an odd sequence number is not infinite, or an even one is")


class ForwardingTable:
    """All destinations that node `node` knows; row i of each column belongs to destination i."""

    def __init__(self, node: int) -> None:
        self.node = node
        self._size = 0
        self.rows: NDArray[np.void] = np.zeros(0, ROW)
        """Transmitted elements; `freshness` is -1 where a destination is unknown."""
        self.next_hop: NDArray[np.int16] = np.zeros(0, np.int16)
        """NOBODY where the metric is infinite."""
        self._known: NDArray[np.int64] | None = None
        self._grow(max(node, 15))

    def _grow(self, largest: int) -> None:
        if largest < self._size:
            return
        size = max(largest + 1, 2 * self._size)
        rows = np.zeros(size, ROW)
        rows["dst"] = np.arange(size)
        rows["freshness"] = _UNKNOWN
        next_hop = np.full(size, NOBODY, np.int16)
        rows[: self._size] = self.rows
        next_hop[: self._size] = self.next_hop
        self.rows, self.next_hop, self._size = rows, next_hop, size
        self._everyone = np.arange(size)
        self.freshness: NDArray[np.int64] = rows["freshness"]
        """A view of that column."""
        self.flags: NDArray[np.uint16] = rows["flags"]
        """A view: bit 0 is the class (world.messages.Cls), bit 1 the need of policy scout."""

    @property
    def known(self) -> NDArray[np.int64]:
        """Ids of all known destinations, ascending, this node's own among them."""
        if self._known is None:
            self._known = np.flatnonzero(self.freshness >= 0)
        return self._known

    def hop(self, dst: int) -> int:
        """Hop count to a destination; UNREACHABLE if there is no route."""
        return hop_of(int(self.freshness[dst])) if dst < self._size else UNREACHABLE

    def hops(self, dst: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Hop counts to known destinations."""
        return (UNREACHABLE - (self.freshness[dst] & 255)).astype(np.uint8)

    def reachable(self) -> NDArray[np.bool_]:
        """Of every id, whether there is a finite route to it."""
        return (self.freshness >= 0) & (self.freshness & 255 > 0)

    def location_m(self, dst: int) -> tuple[float, float]:
        """Where a known destination said that it is."""
        x, y, _, _ = self.rows["place_m"][dst].tolist()
        return x, y

    def target_m(self, dst: int) -> tuple[float, float]:
        """The target that a known destination announced."""
        _, _, x, y = self.rows["place_m"][dst].tolist()
        return x, y

    def set_route(self, dst: int, freshness: int, next_hop: int) -> None:
        """Write the DSDV elements of one entry; the caller answers for the order of freshness."""
        self._grow(dst)
        if self.freshness[dst] < 0:
            self._known = None
        self.next_hop[dst] = next_hop if hop_of(freshness) < UNREACHABLE else NOBODY
        self.freshness[dst] = freshness

    def set_inherent(self, dst: int, flags: int, at_m: tuple[float, float], target_m: tuple[float, float]) -> None:
        """Write the SRRC elements of one entry."""
        self.flags[dst] = flags
        self.rows["place_m"][dst] = (*at_m, *target_m)

    def merge(
        self, senders: NDArray[np.int64], counts: list[int], rows: NDArray[np.void], *, sticky: int = NOBODY
    ) -> None:
        """Take over what neighbors advertised in one tick.

        Of several neighbors with the same freshest offer the present next hop is kept, else the lowest id wins.

        Args:
            senders: (k,) ids of the neighbors, ascending.
            counts: how many rows each sent.
            rows: their checked rows, one table after the other.
            sticky: a destination whose entry is not ours to touch (PROCEDURE 2).
        """
        dst = rows["dst"].astype(np.int64)
        self._grow(int(dst.max(initial=0)))
        offered = rows["freshness"]
        offered = offered - (offered & 255 > 0)
        place = np.repeat(np.arange(len(senders)), counts)
        # One cell for each neighbor and destination; the lowest bit lets the present next hop win a tie.
        rank = np.full((len(senders), self._size), 2 * _UNKNOWN)
        rank[place, dst] = 2 * offered + (self.next_hop[dst] == senders[place])
        best = rank.argmax(0)
        newer = rank[best, self._everyone] >> 1 > self.freshness
        newer[self.node] = False
        if sticky != NOBODY:
            newer[sticky] = False
        won = np.flatnonzero(newer)
        if not won.size:
            return
        if self.freshness[won].min() < 0:
            self._known = None
        source = np.empty(rank.shape, np.int64)
        source[place, dst] = np.arange(len(dst))
        taken = source[best[won], won]
        fresh = offered[taken]
        self.rows[won] = rows[taken]
        self.freshness[won] = fresh
        self.next_hop[won] = np.where(fresh & 255 > 0, senders[best[won]], NOBODY)

    def break_via(self, neighbor: int) -> None:
        """A link is gone: every route through it becomes infinite, with its number + 1 (odd)."""
        broken = np.flatnonzero(self.next_hop == neighbor)
        self.next_hop[broken] = NOBODY
        self.freshness[broken] = (self.freshness[broken] >> 8) + 1 << 8

    def advertised(self) -> NDArray[np.void]:
        """Rows of an update: the whole table, ascending by destination."""
        return self.rows[self.known]

    def check_invariants(self) -> None:
        """Raise AssertionError if the columns contradict one another."""
        known = self.known
        check_rows(self.rows[known])
        others = known[known != self.node]
        assert ((self.next_hop[others] != NOBODY) == (self.hops(others) < UNREACHABLE)).all(), (
            "a route without next hop"
        )
