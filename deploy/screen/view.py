"""`View`, the interface of all that shows a run to a person, and what its implementations share."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Protocol

from world.feed import Event, Snapshot
from world.terms import TICK_S

__all__ = ["Clock", "NoView", "View", "event_line"]


class View(Protocol):
    """Shows a run to a person. All calls come from one thread."""

    def processes(self, pids: Mapping[str, int]) -> None:
        """Living processes by name, whenever they change."""

    def snapshot(self, snapshot: Snapshot) -> None:
        """One tick is over."""

    def event(self, event: Event) -> None:
        """Something happened in the run."""

    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None:
        """Seconds by process and phase of its ticks, so far."""

    def line(self, words: str) -> None:
        """Something happened to a process."""

    def close(self) -> None:
        """Draw the last state."""


class NoView:
    """A view that shows nothing."""

    def processes(self, pids: Mapping[str, int]) -> None: ...
    def snapshot(self, snapshot: Snapshot) -> None: ...
    def event(self, event: Event) -> None: ...
    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None: ...
    def line(self, words: str) -> None: ...
    def close(self) -> None: ...


def event_line(event: Event) -> str | None:
    """How an event is printed: not changes of class, nor the first routes, which all robots find at the start."""
    if event.kind == "role" or (event.kind == "link" and event.tick <= 1):
        return None
    return f"{event.tick * TICK_S:8.1f} s  {event.kind}: {event.text}"


class Clock:
    """Compares simulated time with wall time since the first snapshot."""

    def __init__(self) -> None:
        self._begun: float | None = None
        self._first = 0

    def factor(self, tick: int) -> float:
        now = time.monotonic()
        if self._begun is None:
            self._begun, self._first = now, tick
        passed = now - self._begun
        return (tick - self._first) * TICK_S / passed if passed > 0.05 else 0.0
