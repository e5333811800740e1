"""Merges scan reports into the map that the operators see, and counts what each robot has delivered.

Of each cell it counts the hits and the misses that were reported; sums do not depend on the order of reports, and each
report counts once. What they say of the cell is read from the sums (agents/evidence.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents import _cells
from agents.config import RobotConfig
from agents.evidence import SensorModel
from agents.messages import ACK, AHEAD, AHEAD_NUMBERS, ScanReport

_NONE: Final = np.zeros(0, np.int64)


@dataclass(slots=True, init=False)
class Change:
    """What a report changed in the map, cells ascending."""

    cells: NDArray[np.int64]
    odds: NDArray[np.int8]
    """Their new odds."""
    turned: NDArray[np.int64]
    """Those whose state changed: `MapMerger.cells` has the new ones."""

    def __init__(self, cells: NDArray[np.int64], odds: NDArray[np.int8], turned: NDArray[np.int64]) -> None:
        self.cells = cells
        self.odds = odds
        self.turned = turned


class MapMerger:
    """The map of the MS."""

    def __init__(self, config: RobotConfig) -> None:
        """`config`: of the node of the MS; all nodes have the same sensors."""
        self._sensors = SensorModel(config)
        self.odds = self._sensors.first_odds()
        """(size,) of all cells."""
        self.cells = config.geometry.blank(config.safety_zone_m)
        """(size,) their states: UNKNOWN, FREE or OCCUPIED."""
        self._hits = np.zeros(config.geometry.size, np.int32)
        self._misses = np.where(self.odds < 0, self._sensors.settled, 0).astype(np.int32)
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

    def take(self, report: ScanReport) -> Change | None:
        """Merge a report within its limits (agents/limits.py).

        Of two reports with the same number but different contents the first is merged, and the second noted.

        Returns:
            What it changed; None if this report was here already.
        """
        source = report.origin, report.incarnation
        key = *source, report.number
        content = hash((report.cells.tobytes(), report.values.tobytes(), report.victims))
        if key in self._contents:
            if content == self._contents[key] or key in self._contradicted:
                return None
            self._contradicted.add(key)
            return Change(_NONE, self.odds[:0], _NONE)
        self._contents[key] = content
        complete = self._complete.get(source, 0)
        while (*source, complete + 1) in self._contents:
            complete += 1
        self._complete[source] = complete
        self._newest[source] = max(self._newest.get(source, 0), report.number)
        self._acks = self._ahead = None
        for victim, x, y in report.victims:
            self.victims.setdefault(victim, (x, y))
        sensors = self._sensors
        changed = _cells.tally(
            self._hits, self._misses, report.cells, report.values, self.odds,
            sensors.miss, sensors.worth, sensors.settled,
        )  # fmt: skip
        changed.sort()
        odds = self.odds[changed]
        states = self._sensors.states(odds)
        turned = changed[states != self.cells[changed]]
        self.cells[changed] = states
        return Change(changed, odds, turned)

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
