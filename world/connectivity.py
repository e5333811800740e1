"""How well the robots of a run were connected, from its snapshots."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from world.feed import Snapshot
from world.routes import hop_summary
from world.terms import UNREACHABLE, Mode, seconds_of

__all__ = ["Connectivity"]

_AWAY: Final = int(Mode.AWAY)


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
        self._unconnected = 0
        """Longest time without a route so far."""
        self._unconnected_since: dict[int, int] = {}
        """The first tick without a route, by row of those who take part and have none."""
        self._absences = 0
        self._absent = 0
        self._longest = 0
        self._since: dict[int, int] = {}
        """The first tick of the planned absences under way, by row."""

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
        if self._now[1] < self._now[0] or self._unconnected_since:
            self._add_unconnected(snapshot)
        if _AWAY in snapshot.mode or self._since:
            self._add_absences(snapshot)

    def _add_unconnected(self, snapshot: Snapshot) -> None:
        before, self._unconnected_since = self._unconnected_since, {}
        rows: list[int] = np.flatnonzero((snapshot.present == 1) & (snapshot.hops == UNREACHABLE)).tolist()
        for row in rows:
            self._unconnected_since[row] = before.get(row, snapshot.tick)
            self._unconnected = max(self._unconnected, snapshot.tick + 1 - self._unconnected_since[row])

    def _add_absences(self, snapshot: Snapshot) -> None:
        before, self._since = self._since, {}
        for row, mode in enumerate(snapshot.mode.tolist()):
            if mode == _AWAY and snapshot.present[row] and snapshot.hops[row] == UNREACHABLE:
                self._since[row] = before.get(row, snapshot.tick)
                self._absences += row not in before
                self._absent += 1
                self._longest = max(self._longest, snapshot.tick + 1 - self._since[row])

    @property
    def fraction(self) -> float:
        """Share of the robot ticks that were connected (`world.routes.connected`), 0..1; 0 if no robot took part."""
        return self._connected / self._present if self._present else 0.0

    @property
    def longest_absence_s(self) -> float:
        """For how long a robot that takes part had no route to the MS at most, on purpose or not."""
        return seconds_of(self._unconnected)

    @property
    def planned_absences(self) -> dict[str, Any]:
        """How often a robot on a sortie had no route to the MS, its share of the robot ticks, and the longest time."""
        return {
            "count": self._absences,
            "fraction": self._absent / self._present if self._present else 0.0,
            "longest_s": seconds_of(self._longest),
        }
