"""The message pattern of a tick without any computation: what every floor sends, and what it measures.

Sizes are those of a mission: a sense (with a scan each fifth tick), a motion, a table of all robots as the broadcast
of each tick, and an inbox with the broadcasts of the neighbors.
"""

from __future__ import annotations

import json
import time
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

__all__ = ["DEGREE", "Pattern", "TickTimes"]

DEGREE: Final = 8
"""Neighbors that a robot hears; fewer if there are fewer robots."""


@dataclass(frozen=True)
class Pattern:
    """The messages of a run with `robots` robots and the station."""

    robots: int
    wall_s: float
    """Wall time of the ticks."""
    scan_ticks: int = 5
    beams: int = 180

    @property
    def nodes(self) -> range:
        return range(self.robots + 1)

    @property
    def frame_bytes(self) -> int:
        return 28 * (self.robots + 1) + 20

    @property
    def heard(self) -> int:
        return min(DEGREE, self.robots)

    def sense_bytes(self, node: int, tick: int) -> int:
        return 40 + (8 * self.beams if node and (tick + node) % self.scan_ticks == 0 else 0)

    @property
    def inbox_bytes(self) -> int:
        return 10 + self.heard * (self.frame_bytes + 12)


class TickTimes:
    """The world's clock: how long each tick took, written to a file at the end."""

    def __init__(self, path: Path, wall_s: float) -> None:
        self._path, self._wall_s = path, wall_s
        self._began_at: float | None = None
        self._last = self._first = 0.0
        self._ticks_s = array("d")

    def tick(self) -> bool:
        """Begin a tick; False if it is time to end."""
        now = time.perf_counter()
        if self._began_at is None:
            self._began_at, self._first = time.time(), now
        else:
            self._ticks_s.append(now - self._last)
        self._last = now
        return now - self._first < self._wall_s

    def write(self) -> None:
        """Write the result."""
        low, high = np.percentile(np.frombuffer(self._ticks_s), (50, 99)) * 1e3
        result: dict[str, Any] = {
            "began": self._began_at,
            "ended": (self._began_at or 0.0) + self._last - self._first,
            "ticks": len(self._ticks_s),
            "p50_ms": round(float(low), 3),
            "p99_ms": round(float(high), 3),
        }
        draft = self._path.with_suffix(".part")
        draft.write_text(json.dumps(result))
        draft.replace(self._path)
