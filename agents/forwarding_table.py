"""The forwarding table of the paper's Fig. 2.

DSDV elements: dst, next hop, hop count, sequence number. SRRC elements: location, cls; we add the target. How new an
entry is, and how short, is one integer, so that Perkins & Bhagwat's rule ("a newer number always replaces, an equal one
only with a smaller metric") is one comparison:

    freshness = seqno * 256 + (255 - hop count), or -1 for an unknown destination.

Freshness never falls at any node, and along next hops it never falls either; that is why no loop can arise.
A broken entry (hop count 255, odd number) is kept, not deleted.

Plain dictionaries: at ten updates a second from each of a handful of neighbors, a loop over a few hundred rows costs
less than as many calls into numpy (ARCHITECTURE.md, "What was measured").
"""

from __future__ import annotations

import struct
from typing import Final

from bus.codec import WireError
from world.compiled import kernels
from world.messages import MAX_NODE, NOBODY, UNREACHABLE

ROW: Final = struct.Struct("<HQ18s")
"""A row on the air: dst, freshness, inherent elements."""

_INHERENT: Final = struct.Struct("<H4i")
"""What a destination says of itself, and others pass on unread: flags, and location and target (x, y). Every bit
pattern is a valid one, so nothing in it has to be checked."""

_PER_METRE: Final = 100_000.0
"""Places travel in steps of 10 um, up to 21 km: coarser, and a robot that hugs a wall seems to stand in it."""

_BAD_ROW: Final = -2
"""What the compiled merge returns for a row that can't be."""
_BAD_ROW_WORDS: Final = "number and metric disagree (odd means infinite), or there is no such node"

_CLS_BIT: Final = 1
_NEED_BIT: Final = 2


def freshness_of(seqno: int, hop: int) -> int:
    """One comparable integer of a sequence number and a hop count."""
    return seqno * 256 + UNREACHABLE - hop


def hop_of(freshness: int) -> int:
    """Hop count of an entry; UNREACHABLE for an unknown one."""
    return UNREACHABLE - (freshness & 255) if freshness >= 0 else UNREACHABLE


def _consistent(freshness: int) -> bool:
    """Odd numbers are infinite, even ones are not."""
    return (freshness & 256 == 0) == (freshness & 255 > 0)


class ForwardingTable:
    """All destinations that node `node` knows, its own entry among them."""

    def __init__(self, node: int) -> None:
        self.node = node
        self.freshness: dict[int, int] = {}
        self.next_hop: dict[int, int] = {}
        """NOBODY where the metric is infinite."""
        self._inherent: dict[int, bytes] = {}

    def hop(self, dst: int) -> int:
        """Hop count to a destination; UNREACHABLE if there is no route."""
        return hop_of(self.freshness.get(dst, -1))

    def next_hop_to(self, dst: int) -> int:
        """Next hop to a destination, or NOBODY."""
        return self.next_hop.get(dst, NOBODY)

    def location_m(self, dst: int) -> tuple[float, float]:
        """Where a known destination said that it is."""
        _, x, y, _, _ = _INHERENT.unpack(self._inherent[dst])
        return x / _PER_METRE, y / _PER_METRE

    def target_m(self, dst: int) -> tuple[float, float]:
        """The target that a known destination announced."""
        _, _, _, x, y = _INHERENT.unpack(self._inherent[dst])
        return x / _PER_METRE, y / _PER_METRE

    def cls(self, dst: int) -> int:
        """Class of a known destination (world.messages.Cls)."""
        return self._inherent[dst][0] & _CLS_BIT

    def needs(self, dst: int) -> bool:
        """Whether a known destination announced its need (policy scout)."""
        return bool(self._inherent[dst][0] & _NEED_BIT)

    def shape(self) -> tuple[dict[int, int], list[int], list[int]]:
        """What seldom changes: next hops, hop counts and classes."""
        hops = [freshness & 255 for freshness in self.freshness.values()]
        return self.next_hop.copy(), hops, [inherent[0] & _CLS_BIT for inherent in self._inherent.values()]

    def search_robots(self) -> list[int]:
        """Other SRs to which there is a route, ascending (paper, II-A.3: the SRs in the network)."""
        me, inherent = self.node, self._inherent
        return sorted(
            dst for dst, hop in self.next_hop.items() if hop != NOBODY and dst != me and not inherent[dst][0] & _CLS_BIT
        )

    def set_route(self, dst: int, freshness: int, next_hop: int) -> None:
        """Write the DSDV elements of one entry; the caller answers for the order of freshness."""
        self.freshness[dst] = freshness
        self.next_hop[dst] = next_hop if hop_of(freshness) < UNREACHABLE else NOBODY

    def set_inherent(
        self, dst: int, cls: int, at_m: tuple[float, float], target_m: tuple[float, float], *, need: bool = False
    ) -> None:
        """Write the SRRC elements of one entry."""
        flags = cls | _NEED_BIT * need
        if kernels is not None:
            self._inherent[dst] = kernels.inherent(flags, *at_m, *target_m, _PER_METRE)
            return
        places = [round(_PER_METRE * value) for value in (*at_m, *target_m)]
        self._inherent[dst] = _INHERENT.pack(flags, *places)

    def merge(self, sender: int, rows: bytes, before: dict[int, int], sticky: int) -> int:
        """Take over what one neighbor advertised.

        Of several neighbors with the same freshest offer the present next hop is kept, else the first one wins.

        Args:
            sender: the neighbor.
            rows: its table, a run of ROW.
            before: the next hops before the first update of this tick was merged.
            sticky: a destination whose entry is not ours to touch (PROCEDURE 2).

        Returns:
            Freshness of the neighbor's own entry for `sticky`, or -1.

        Raises:
            WireError: not a run of ROW, a row that can't be, or the sender never said where it is; what came before it
                is merged.
        """
        me, known, next_hop, inherent_of = self.node, self.freshness, self.next_hop, self._inherent
        about_sticky = -1
        if len(rows) % ROW.size:
            raise WireError("not a run of rows")
        if kernels is not None:
            about_sticky = kernels.merge(rows, me, sender, known, next_hop, inherent_of, before, sticky, MAX_NODE)
            if about_sticky == _BAD_ROW:
                raise WireError(_BAD_ROW_WORDS)
        else:
            for dst, freshness, inherent in ROW.iter_unpack(rows):
                if dst == sticky:
                    if not _consistent(freshness):
                        raise WireError(_BAD_ROW_WORDS)
                    about_sticky = freshness
                    continue
                # One hop more than the neighbor's own; an infinite metric stays what it is.
                offered = freshness - 1 if freshness & 255 else freshness
                present = known.get(dst, -1)
                if offered < present or dst == me or (offered == present and before.get(dst) != sender):
                    continue
                if not _consistent(offered) or dst > MAX_NODE:
                    raise WireError(_BAD_ROW_WORDS)
                known[dst] = offered
                next_hop[dst] = sender if offered & 255 else NOBODY
                inherent_of[dst] = inherent
        if sender not in inherent_of:
            raise WireError("a table lacks its sender's own row")
        return about_sticky

    def break_via(self, neighbor: int) -> None:
        """A link is gone: every route through it becomes infinite, with its number + 1 (odd)."""
        for dst, hop in self.next_hop.items():
            if hop == neighbor:
                self.next_hop[dst] = NOBODY
                self.freshness[dst] = (self.freshness[dst] >> 8) + 1 << 8

    def advertised(self) -> bytes:
        """Encode the whole table as a run of ROW, in the order in which destinations became known."""
        if kernels is not None:
            rows: bytes = kernels.advertised(self.freshness, self._inherent)
            return rows
        inherent, pack = self._inherent, ROW.pack
        return b"".join([pack(dst, freshness, inherent[dst]) for dst, freshness in self.freshness.items()])

    def check_invariants(self) -> None:
        """Raise AssertionError if the columns contradict one another."""
        assert self.freshness.keys() == self.next_hop.keys() <= self._inherent.keys(), "an entry lacks an element"
        for dst, freshness in self.freshness.items():
            assert _consistent(freshness), f"number and metric of {dst} disagree"
            finite = hop_of(freshness) < UNREACHABLE
            assert (self.next_hop[dst] != NOBODY) == finite, f"a route to {dst} without next hop, or the reverse"
