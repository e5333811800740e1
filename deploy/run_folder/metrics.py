"""metrics.csv: the state of a run at every simulated second, one row each."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from world.feed import Snapshot
from world.growing_file import GrowingFile
from world.routes import hop_summary
from world.terms import Cls, seconds_of, tick_of

__all__ = ["RATE", "Metrics"]

RATE: Final = "search_rate_"
"""Prefix of the column of a search cell, before the cell's name."""

_COLUMNS: Final = (
    "time_s", "robots_present", "robots_connected", "relays", "max_hops", "mean_hops", "scan_reports_merged",
    "scan_reports_buffered", "victims_found",
)  # fmt: skip
_TICKS_PER_ROW: Final = tick_of(1.0)


class Metrics:
    """The file while it is written. The search rates stay in memory too, for the time series of a study."""

    def __init__(self, path: Path, cells: Sequence[str]) -> None:
        """Create the file, with a column for each search cell.

        Raises:
            OSError: it can't be written.
        """
        self._cells = cells
        self.file = GrowingFile(path)
        self._rows = csv.writer(self.file)
        self._rows.writerow([*_COLUMNS, *(RATE + cell for cell in cells)])
        self._second = -1
        """Simulated second of the last row."""
        # Eight bytes a number: a run of days has a hundred thousand rows.
        self._time_s = array("d")
        self._rates = [array("d") for _ in cells]

    def add(self, s: Snapshot) -> None:
        """Add a tick, in the order of ticks. The first of each second becomes a row."""
        second = s.tick // _TICKS_PER_ROW
        if second <= self._second:
            return
        self._second = second
        present = s.present == 1
        connected, most, mean = hop_summary(s)
        rates = [round(rate, 6) for rate in s.search_rate] or [0.0] * len(self._cells)
        self._time_s.append(seconds_of(s.tick))
        for column, rate in zip(self._rates, rates, strict=True):
            column.append(rate)
        self._rows.writerow([
            self._time_s[-1], int(present.sum()), connected, int((present & (s.cls == Cls.RR)).sum()),
            most if connected else "", round(mean, 3) if connected else "",
            s.merged, s.reports_buffered, len(s.victims_found), *rates,
        ])  # fmt: skip

    def series(self, step: int) -> dict[str, list[float]]:
        """Every `step`-th row and the last: `time_s`, and the search rate of each cell by its name."""
        last = len(self._time_s) - 1
        kept = [i for i in range(last + 1) if i % step == 0 or i == last]
        return {"time_s": [self._time_s[i] for i in kept]} | {
            cell: [rates[i] for i in kept] for cell, rates in zip(self._cells, self._rates, strict=True)
        }
