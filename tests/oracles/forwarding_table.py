"""The rows of a forwarding table, one by one in Python: the oracle of agents/_rows.pyx."""

from __future__ import annotations

from array import array

from agents.forwarding_table import ROW, ForwardingTable, hop_of
from bus.codec import WireError
from world.terms import NOBODY, STATION, UNREACHABLE, Cls


def _possible(dst: int, freshness: int, sender: int, tick: int) -> bool:
    """agents/limits.py."""
    seqno, hop = freshness >> 8, 255 - (freshness & 255)
    if hop == 255:
        return seqno % 2 == 1 and seqno // 2 < tick and dst != sender
    return seqno % 2 == 0 and seqno // 2 + hop < tick and (hop == 0) == (dst == sender)


def check_invariants(table: ForwardingTable) -> None:
    """Raise AssertionError if the columns of a table contradict one another."""
    size = len(table._freshness)
    assert len(table._next_hop) == size, "columns of different length"
    assert len(table._inherent) == size * 18, "columns of different length"
    assert sorted(table.known) == [dst for dst in range(size) if table._freshness[dst] >= 0], "known, or not?"
    for dst in range(size):
        freshness = table._freshness[dst]
        finite = hop_of(freshness) < UNREACHABLE
        assert (table._next_hop[dst] != NOBODY) == finite, f"a route to {dst} without next hop, or the reverse"
        agree = (freshness >> 8) % 2 == (freshness & 255 == 0)
        assert freshness < 0 or agree, f"number and metric of {dst} disagree: the metric is infinite if it is odd"


class OracleTable(ForwardingTable):
    """A table that uses no compiled loop."""

    def merge(self, sender: int, rows: bytes, before: array[int], sticky: int, tick: int) -> int:
        about_sticky = -1
        possible = len(rows) % ROW.size == 0 and all(
            dst <= self._robots and _possible(dst, freshness, sender, tick)
            for dst, freshness, _ in ROW.iter_unpack(rows)
        )
        known = sender in (STATION, *(dst for dst, _, _ in ROW.iter_unpack(rows)), *self.known) if possible else False
        if not known:
            raise WireError("no sequence of rows, a row that can't be, or none of the sender's own")
        for dst, freshness, inherent in ROW.iter_unpack(rows):
            if dst == sticky:
                about_sticky = freshness
                continue
            # One hop more than the neighbor's own; an infinite metric stays what it is.
            offered = freshness - 1 if freshness & 255 else freshness
            present = self.freshness(dst)
            if offered < present or dst == self.node:
                continue
            if offered == present and (dst >= len(before) or before[dst] != sender):
                continue
            self.set_route(dst, offered, sender)
            self._inherent[dst * 18 : (dst + 1) * 18] = inherent
        return about_sticky

    def search_robots(self) -> list[int]:
        return [
            dst
            for dst, hop in enumerate(self.next_hops())
            if hop != NOBODY and dst != self.node and self.cls(dst) == Cls.SR
        ]

    def advertised(self) -> bytes:
        return b"".join(
            ROW.pack(dst, self.freshness(dst), bytes(self._inherent[dst * 18 : (dst + 1) * 18])) for dst in self.known
        )
