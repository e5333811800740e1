"""How well the robots of a run were connected, from its snapshots."""

from __future__ import annotations

from world.feed import Snapshot
from world.terms import UNREACHABLE

__all__ = ["Connectivity"]


class Connectivity:
    """Counts robot ticks: one for each robot that takes part in a tick."""

    def __init__(self) -> None:
        self._present = 0
        self._connected = 0
        self.max_hops = 0
        """Of the longest finite route to the MS so far."""

    def add(self, snapshot: Snapshot) -> None:
        """Count one tick."""
        # For the few robots of most runs a loop is faster than numpy.
        for here, hops in zip(snapshot.present.tolist(), snapshot.hops.tolist(), strict=True):
            self._present += here
            if here and hops != UNREACHABLE:
                self._connected += 1
                self.max_hops = max(self.max_hops, hops)

    @property
    def fraction(self) -> float:
        """Share of the robot ticks with a finite route to the MS, 0..1; 0 if no robot took part."""
        return self._connected / self._present if self._present else 0.0
