"""SRRC: search and relay robot classification [paper 4.1, 4.4].

Class: a robot with an empty inv is at the end of a chain and is a search robot (SR). Any other robot is a relay (RR).
MSR of a relay: 1) among the SRs of the forwarding table discard those whose next hop is the NMS; 2) of the others take
the one farthest from the MS along the shortest path on the relay's own map.
"""

from __future__ import annotations

from collections.abc import Callable

from agents.config import Classing
from agents.forwarding_table import ForwardingTable
from world.terms import NOBODY, Cls


def eligible_msrs(table: ForwardingTable, nms: int) -> list[int]:
    """Rule 1 [paper 4.4]: the SRs of a forwarding table, ascending, without those whose next hop is the NMS."""
    return [node for node in table.search_robots() if table.next_hop_to(node) != nms]


def farthest_msr(
    candidates: list[int],
    table: ForwardingTable,
    distances_to_ms_m: Callable[[list[tuple[float, float]]], list[float]],
    present: int,
    margin_m: float,
) -> int:
    """Rule 2 [paper 4.4].

    Args:
        candidates: the SRs that rule 1 left.
        table: the forwarding table of the relay.
        distances_to_ms_m: path lengths from the MS to places.
        present: the present MSR.
        margin_m: a new MSR is at least this much farther than the present one [paper 4.5].

    Returns:
        The MSR's id, or NOBODY if there is no candidate.
    """
    if len(candidates) <= 1:
        return candidates[0] if candidates else NOBODY
    lengths = distances_to_ms_m([table.location_m(node) for node in candidates])
    far = dict(zip(candidates, lengths, strict=True))
    best = max(candidates, key=lambda node: (far[node], -node))
    if present in far and far[best] < far[present] + margin_m:
        return present
    return best


class Classifier:
    """The class of one robot, tick by tick."""

    def __init__(self, rules: Classing) -> None:
        self._rules = rules
        self.cls = Cls.SR
        self._empty_since: int | None = None

    def step(self, tick: int, inv: list[int]) -> Cls:
        """The class at a tick: RR at once, SR again only after inv was empty for a while [paper 4.2]."""
        if inv:
            self.cls = Cls.RR
            self._empty_since = None
        else:
            if self._empty_since is None:
                self._empty_since = tick
            if tick - self._empty_since >= self._rules.sr_after_ticks:
                self.cls = Cls.SR
        return self.cls
