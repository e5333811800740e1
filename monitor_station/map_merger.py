"""Merges scan reports into the map that the operators see, and counts what each robot has delivered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.messages import ACK, AHEAD, AHEAD_NUMBERS, ScanReport
from world.grid import GridGeometry


class MapMerger:
    """Occupied overrides free, and free overrides unknown, so the map does not depend on the order of reports."""

    def __init__(self, geometry: GridGeometry, safety_zone_m: tuple[float, float, float, float]) -> None:
        self.geometry = geometry
        self.cells = geometry.blank(safety_zone_m)
        self.victims: dict[int, tuple[float, float]] = {}
        self._complete: dict[tuple[int, int], int] = {}
        """By robot and incarnation: the highest report number without a gap."""
        self._contents: dict[tuple[int, int, int], int] = {}
        """By robot, incarnation and number: a hash of the content of the report."""
        self._contradicted: set[tuple[int, int, int]] = set()
        """Reports that came with two contents. Only one of them can be the robot's."""
        self._newest: dict[tuple[int, int], int] = {}
        """By robot and incarnation: the highest report number."""
        self._acks: bytes | None = b""
        """Result of `acks`; None once it is out of date."""
        self._ahead: bytes | None = b""
        """Result of `ahead`, likewise."""

    def take(self, report: ScanReport) -> tuple[NDArray[np.int64], NDArray[np.int8]] | None:
        """Merge a report within its limits (agents/limits.py).

        Of two reports with the same number but different contents the first is merged, and the second noted.

        Returns:
            The changed cells, ascending, and their values; None if this report is not merged.
        """
        source = report.origin, report.incarnation
        key = *source, report.number
        content = hash((report.cells.tobytes(), report.values.tobytes(), report.victims))
        if key in self._contents:
            if content == self._contents[key] or key in self._contradicted:
                return None
            self._contradicted.add(key)
            return np.zeros(0, np.int64), self.cells[:0]
        self._contents[key] = content
        complete = self._complete.get(source, 0)
        while (*source, complete + 1) in self._contents:
            complete += 1
        self._complete[source] = complete
        self._newest[source] = max(self._newest.get(source, 0), report.number)
        self._acks = self._ahead = None
        for victim, x, y in report.victims:
            self.victims.setdefault(victim, (x, y))
        changed = np.sort(report.cells[report.values > self.cells[report.cells]].astype(np.int64))
        np.maximum.at(self.cells, report.cells, report.values)
        return changed, self.cells[changed]

    @property
    def merged(self) -> int:
        """How many reports were merged."""
        return len(self._contents)

    def tally(self) -> dict[str, Any]:
        """Which reports are here, for the summary; robot incarnations by "robot/incarnation".

        `complete` has the highest number without a gap, `ahead` the numbers beyond it, and `contradicted` how many
        reports came with two contents.
        """
        ahead: dict[str, list[int]] = {}
        for robot, incarnation, number in sorted(self._contents):
            if number > self._complete[robot, incarnation]:
                ahead.setdefault(f"{robot}/{incarnation}", []).append(number)
        return {
            "merged": self.merged,
            "complete": {f"{robot}/{incarnation}": n for (robot, incarnation), n in sorted(self._complete.items())},
            "ahead": ahead,
            "contradicted": len(self._contradicted),
        }

    def acks(self) -> bytes:
        """Acknowledgements (ACK), one after the other: of each robot incarnation the highest number without a gap."""
        if self._acks is None:
            self._acks = b"".join([ACK.pack(*source, number) for source, number in sorted(self._complete.items())])
        return self._acks

    def ahead(self) -> bytes:
        """Of each robot incarnation with a gap the reports beyond it (AHEAD), as many as a mask covers."""
        if self._ahead is None:
            rows = []
            for source, number in sorted(self._complete.items()):
                beyond = min(self._newest[source] - number - 1, AHEAD_NUMBERS)
                mask = sum(1 << bit for bit in range(beyond) if (*source, number + 2 + bit) in self._contents)
                if mask:
                    rows.append(AHEAD.pack(*source, number, mask))
            self._ahead = b"".join(rows)
        return self._ahead
