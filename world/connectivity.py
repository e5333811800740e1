"""How well the robots of a run were connected, from its snapshots."""

from __future__ import annotations

from world.feed import Snapshot
from world.routes import hop_summary

__all__ = ["Connectivity"]


class Connectivity:
    """Counts robot ticks: one for each robot that takes part in a tick."""

    def __init__(self) -> None:
        self._present = 0
        self._connected = 0
        self._counted = b""
        self._now = 0, 0
        """Robots that take part, and those that are connected, by presence and hops as in `_counted`."""
        self.max_hops = 0
        """Of the longest finite route to the MS so far."""

    def add(self, snapshot: Snapshot) -> None:
        """Count one tick."""
        key = snapshot.present.tobytes() + snapshot.hops.tobytes()
        if key != self._counted:  # in most ticks nothing has changed
            self._counted = key
            connected, most, _ = hop_summary(snapshot)
            self._now = int(snapshot.present.sum()), connected
            self.max_hops = max(self.max_hops, most)
        self._present += self._now[0]
        self._connected += self._now[1]

    @property
    def fraction(self) -> float:
        """Share of the robot ticks that were connected (`world.routes.connected`), 0..1; 0 if no robot took part."""
        return self._connected / self._present if self._present else 0.0
