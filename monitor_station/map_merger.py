"""Merges scan reports into the map that the operators see, and keeps count of what each robot has delivered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.messages import ACK, ScanReport
from bus.codec import WireError
from world.grid import FREE, UNKNOWN, GridGeometry


class MapMerger:
    """Occupied beats free beats unknown, so the order of reports cannot matter to the map."""

    def __init__(self, geometry: GridGeometry, safety_zone_m: tuple[float, float, float, float]) -> None:
        self.geometry = geometry
        self.cells: NDArray[np.int8] = np.full(geometry.size, UNKNOWN, np.int8)
        self.cells[geometry.rectangle(*safety_zone_m)] = FREE
        self.victims: dict[int, tuple[float, float]] = {}
        self.merged = 0
        """Different reports taken in."""
        self._complete: dict[tuple[int, int], int] = {}
        self._ahead: dict[tuple[int, int], set[int]] = {}
        self._acks: bytes | None = b""
        """What `acks` returns; None: to be made anew."""

    def take(self, report: ScanReport) -> tuple[NDArray[np.int64], NDArray[np.int8]] | None:
        """Merge a report; returns the changed cells, ascending, and their values, or None for one that is known.

        Raises:
            WireError: a cell lies outside the grid.
        """
        if not self.geometry.holds(report.cells):
            raise WireError("a cell lies outside the grid")
        source = report.origin, report.incarnation
        complete, ahead = self._complete.get(source, 0), self._ahead.setdefault(source, set())
        if report.number <= complete or report.number in ahead:
            return None
        ahead.add(report.number)
        while complete + 1 in ahead:
            complete += 1
            ahead.remove(complete)
        self._complete[source] = complete
        self._acks = None
        self.merged += 1
        for victim, x, y in report.victims:
            self.victims.setdefault(victim, (x, y))
        changed = np.unique(report.cells[report.values > self.cells[report.cells]].astype(np.int64))
        np.maximum.at(self.cells, report.cells, report.values)
        return changed, self.cells[changed]

    @property
    def complete(self) -> dict[str, int]:
        """By "robot/incarnation": the highest report number that is here without a gap."""
        return {f"{robot}/{incarnation}": number for (robot, incarnation), number in sorted(self._complete.items())}

    def acks(self) -> bytes:
        """A run of ACK: per robot incarnation the highest report number that is here without a gap."""
        if self._acks is None:
            self._acks = b"".join([ACK.pack(*source, number) for source, number in sorted(self._complete.items())])
        return self._acks
