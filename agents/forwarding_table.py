"""The forwarding table [paper 2.1, 2.2].

DSDV elements: dst, next hop, hop count, sequence number. SRRC elements: location, cls; we add the target [paper 2.9].
Sequence number and hop count form one integer, so that Perkins & Bhagwat's rule [paper 2.6] ("a newer number always
replaces, an equal one only with a smaller metric") is one comparison:

    freshness = seqno * 256 + (255 - hop count), or -1 for an unknown destination.

Freshness never falls at any node, and rises along next hops, from tick to tick, at all nodes that take part in a tick;
so no loop can arise [paper 3.6]. A node that is back, but has not taken its first step, does not count
(ARCHITECTURE.md). A broken entry (hop count 255, odd number) is kept, not deleted.

The columns are arrays, and the destination's id is the index. A node merges degree x N rows in every tick, and most of
them are no fresher than its own entries; an index shows that sooner than a hash does.
"""

from __future__ import annotations

import struct
from array import array
from typing import Final

from agents import _rows
from bus.codec import WireError
from world.terms import MAX_NODE, NOBODY, UNREACHABLE

ROW: Final = struct.Struct("<HQ18s")
"""A row in an update: dst, freshness, inherent elements."""

_INHERENT: Final = struct.Struct("<H4i")
"""What a destination says of itself and others pass on unread: flags, location (x, y), target (x, y). Every bit pattern
is valid, so nothing has to be checked."""

_INHERENT_BYTES: Final = 18
_PER_METRE: Final = 100_000.0
"""Coordinates travel in steps of 10 um, up to 21 km. With coarser steps a robot at a wall seems to stand in it."""

_CLS_BIT: Final = 1
_NEED_BIT: Final = 2


def freshness_of(seqno: int, hop: int) -> int:
    """One comparable integer of a sequence number and a hop count."""
    return seqno * 256 + UNREACHABLE - hop


def hop_of(freshness: int) -> int:
    """Hop count of an entry; UNREACHABLE for an unknown one."""
    return UNREACHABLE - (freshness & 255) if freshness >= 0 else UNREACHABLE


class ForwardingTable:
    """All destinations that node `node` knows, its own entry among them."""

    def __init__(self, node: int, robots: int = MAX_NODE) -> None:
        """`robots`: N, the highest destination."""
        self.node = node
        self._robots = robots
        self.known: list[int] = []
        """Destinations, in the order in which they became known."""
        self._freshness = array("q")
        self._next_hop = array("h")
        self._inherent = bytearray()

    def freshness(self, dst: int) -> int:
        """Freshness of an entry: how new it is, and how short the route."""
        return self._freshness[dst] if dst < len(self._freshness) else -1

    def hop(self, dst: int) -> int:
        """Hop count to a destination; UNREACHABLE if there is no route."""
        return hop_of(self.freshness(dst))

    def next_hop_to(self, dst: int) -> int:
        """Next hop to a destination, or NOBODY."""
        return self._next_hop[dst] if 0 <= dst < len(self._next_hop) else NOBODY

    def next_hops(self) -> array[int]:
        """A copy of all next hops, by destination; NOBODY where the metric is infinite."""
        return self._next_hop[:]

    def location_m(self, dst: int) -> tuple[float, float]:
        """Location that a known destination announced."""
        _, x, y, _, _ = _INHERENT.unpack_from(self._inherent, dst * _INHERENT_BYTES)
        return x / _PER_METRE, y / _PER_METRE

    def target_m(self, dst: int) -> tuple[float, float]:
        """Target that a known destination announced."""
        _, _, _, x, y = _INHERENT.unpack_from(self._inherent, dst * _INHERENT_BYTES)
        return x / _PER_METRE, y / _PER_METRE

    def cls(self, dst: int) -> int:
        """Class of a known destination (world.terms.Cls)."""
        return self._inherent[dst * _INHERENT_BYTES] & _CLS_BIT

    def needs(self, dst: int) -> bool:
        """Whether a known destination announced need (docs/scout.md)."""
        return bool(self._inherent[dst * _INHERENT_BYTES] & _NEED_BIT)

    def shape(self) -> tuple[bytes, list[int], list[int]]:
        """The elements that change seldom: next hops, hop counts and classes."""
        hops = [freshness & 255 for freshness in self._freshness]
        return self._next_hop.tobytes(), hops, [self.cls(dst) for dst in self.known]

    def search_robots(self) -> list[int]:
        """Other SRs to which there is a route, ascending: the SRs of the network in [paper 4.3]."""
        return _rows.search_robots(self._next_hop, self._inherent, self.node)

    def set_route(self, dst: int, freshness: int, next_hop: int) -> None:
        """Write the DSDV elements of one entry. The caller must not lower its freshness."""
        self._make_room(dst)
        if self._freshness[dst] < 0:
            self.known.append(dst)
        self._freshness[dst] = freshness
        self._next_hop[dst] = next_hop if hop_of(freshness) < UNREACHABLE else NOBODY

    def set_inherent(
        self, dst: int, cls: int, at_m: tuple[float, float], target_m: tuple[float, float], *, need: bool = False
    ) -> None:
        """Write the SRRC elements of one entry."""
        self._make_room(dst)
        x, y = at_m
        target_x, target_y = target_m
        _rows.announce(
            self._inherent, dst, cls | _NEED_BIT * need,
            _PER_METRE * x, _PER_METRE * y, _PER_METRE * target_x, _PER_METRE * target_y,
        )  # fmt: skip

    def _make_room(self, dst: int) -> None:
        more = dst + 1 - len(self._freshness)
        if more > 0:
            self._freshness.extend([-1] * more)
            self._next_hop.extend([NOBODY] * more)
            self._inherent.extend(bytes(more * _INHERENT_BYTES))

    def merge(self, sender: int, rows: bytes, before: array[int], sticky: int, tick: int) -> int:
        """Take over what one neighbor advertised.

        Of several neighbors with the same freshest offer the present next hop wins, else the first one [paper 2.7].

        Args:
            sender: the neighbor.
            rows: its table, a sequence of ROW.
            before: `next_hops()` as it was before the first update of this tick.
            sticky: a destination whose entry this leaves as it is: the MS [paper 3.2].
            tick: in which it is heard.

        Returns:
            Freshness of the neighbor's own entry for `sticky`, or -1.

        Raises:
            WireError: not a sequence of ROW, an impossible row (agents/limits.py), or no row of the sender's own; then
                nothing is merged.
        """
        about_sticky = _rows.merge(
            rows, self.node, sender, self.known, self._freshness, self._next_hop, self._inherent, before, sticky,
            self._robots, tick, self._make_room,
        )  # fmt: skip
        if about_sticky is None:
            raise WireError("no sequence of rows, a row that can't be, or none of the sender's own")
        return about_sticky

    def break_via(self, neighbor: int) -> None:
        """Break every route through a neighbor: infinite hop count, and number + 1, which is odd [paper 2.6, 2.8]."""
        for dst, hop in enumerate(self._next_hop):
            if hop == neighbor:
                self._next_hop[dst] = NOBODY
                self._freshness[dst] = (self._freshness[dst] >> 8) + 1 << 8

    def advertised(self, known: list[int] | None = None) -> bytes:
        """Encode known destinations as a sequence of ROW; None: all, in the order in which they became known."""
        return _rows.advertised(self.known if known is None else known, self._freshness, self._inherent)
