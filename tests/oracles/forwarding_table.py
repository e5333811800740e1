"""The rows of a forwarding table, one by one in Python: the oracle of agents/_rows.pyx."""

from __future__ import annotations

from array import array

from agents.forwarding_table import ROW, ForwardingTable
from bus.codec import WireError
from world.terms import MAX_NODE, NOBODY, STATION, Cls

_BAD_ROW = "number and metric disagree (odd means infinite), or there is no such node or number"


def _possible(freshness: int) -> bool:
    """Odd numbers are infinite, even ones are not, and none is out of reach."""
    return (freshness & 256 == 0) == (freshness & 255 > 0) and freshness < 1 << 62


class OracleTable(ForwardingTable):
    """A table that uses no compiled loop."""

    def merge(self, sender: int, rows: bytes, before: array[int], sticky: int) -> int:
        about_sticky = -1
        if len(rows) % ROW.size:
            raise WireError("not a run of rows")
        for dst, freshness, inherent in ROW.iter_unpack(rows):
            if dst == sticky:
                if not _possible(freshness):
                    raise WireError(_BAD_ROW)
                about_sticky = freshness
                continue
            # One hop more than the neighbor's own; an infinite metric stays what it is.
            offered = freshness - 1 if freshness & 255 else freshness
            present = self.freshness(dst)
            if offered < present or dst == self.node:
                continue
            if offered == present and (dst >= len(before) or before[dst] != sender):
                continue
            if not _possible(offered) or dst > MAX_NODE:
                raise WireError(_BAD_ROW)
            self.set_route(dst, offered, sender)
            self._inherent[dst * 18 : (dst + 1) * 18] = inherent
        if sender != STATION and self.freshness(sender) < 0:
            raise WireError("a table lacks its sender's own row")
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
