"""What a robot reported and the MS's map, as the robot holds it, does not contain yet.

The MS says with its acknowledgements which version of its map contains these reports. Until a robot holds that version,
the evidence of the reports counts on top of the MS's odds; from then on it would count twice.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Evidence = tuple[NDArray[np.uint32], NDArray[np.int8]]
"""Cells, and what they were: FREE for a miss, OCCUPIED for a hit."""


class OwnReports:
    """The evidence of one incarnation's reports, by their number."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Evidence]] = deque()
        self._merged: deque[tuple[int, int]] = deque()
        """(version, number): from that version on the map contains all reports up to that number."""
        self._upto = 0

    def add(self, number: int, cells: NDArray[np.uint32], values: NDArray[np.int8]) -> None:
        """Keep the evidence of the next report."""
        self._waiting.append((number, (cells, values)))

    def contained(self, upto: int, version: int, held: int) -> list[Evidence]:
        """The evidence that the map now contains, each once.

        Args:
            upto: the MS has all reports up to this number ...
            version: ... and its map contains them from this version on.
            held: the version that the robot holds.
        """
        if upto > self._upto:
            self._upto = upto
            self._merged.append((version, upto))
        found: list[Evidence] = []
        while self._merged and self._merged[0][0] <= held:
            _, number = self._merged.popleft()
            while self._waiting and self._waiting[0][0] <= number:
                found.append(self._waiting.popleft()[1])
        return found
