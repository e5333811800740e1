"""Wall time of the ticks: how long they take, and which process was waited for last."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["Stopwatch"]


class Stopwatch:
    """Wall time by tick and by process.

    A tick is cut in three: until everybody has moved (on whoever came last, whatever medium and world do meanwhile),
    until the medium says that the tick is complete (on the medium), and the rest (on the world itself). Waiting on
    purpose, for a speed or a hold, is no part of a tick.
    """

    def __init__(self, unix_s: Callable[[], float]) -> None:
        """`unix_s`: the clock that dates the first and the last tick, in seconds since 1970."""
        self._unix_s = unix_s
        self._ticks_s = array("d")
        self._blame_s: dict[str, float] = {"world": 0.0, "medium": 0.0}
        self._first_unix_s = self._last_unix_s = 0.0

    def tick(
        self, begin_s: float, sent_s: float, moved_s: float, done_s: float, end_s: float, last: str | None
    ) -> None:
        """Count one tick by its five moments of wall time; `last` is the process that answered last."""
        self._last_unix_s = self._unix_s()
        if not self._ticks_s:
            self._first_unix_s = self._last_unix_s - (end_s - begin_s)
        self._ticks_s.append(end_s - begin_s)
        blame = self._blame_s
        blame["world"] += sent_s - begin_s + end_s - done_s
        blame["medium"] += done_s - moved_s
        if last is not None:
            blame[last] = blame.get(last, 0.0) + moved_s - sent_s

    def final(self) -> dict[str, Any]:
        """`tick_ms` {p50, p99}, `tick_blame` (share of the ticks' wall time by process), `ticked_unix_s` (from, to)."""
        if not self._ticks_s:
            return {"tick_ms": {"p50": None, "p99": None}, "tick_blame": {}, "ticked_unix_s": None}
        low, high = np.percentile(np.frombuffer(self._ticks_s, np.float64), (50, 99)) * 1000.0
        total = sum(self._blame_s.values()) or 1.0
        shares = {name: round(spent / total, 4) for name, spent in sorted(self._blame_s.items())}
        return {
            "tick_ms": {"p50": round(float(low), 3), "p99": round(float(high), 3)},
            "tick_blame": shares,
            "ticked_unix_s": [round(self._first_unix_s, 3), round(self._last_unix_s, 3)],
        }
