"""A run as plain lines, for output that is no terminal."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console

from deploy.screen.view import Clock, event_line
from world.feed import Event, Snapshot
from world.terms import TICK_S

__all__ = ["PlainLines"]


class PlainLines:
    """A view that prints each event, and a line of progress at every tenth of the search."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._clock = Clock()
        self._shown = -1
        self._pids: dict[str, int] = {}

    def processes(self, pids: Mapping[str, int]) -> None:
        new = [f"{name} {pid}" for name, pid in pids.items() if self._pids.get(name) != pid]
        self._pids.update(pids)
        if new:
            self.line(f"pids: {', '.join(new)}")

    def snapshot(self, snapshot: Snapshot) -> None:
        factor = self._clock.factor(snapshot.tick)
        rates = snapshot.search_rate
        if rates and (tenth := int(10 * sum(rates) / len(rates) + 1e-9)) > self._shown:
            self._shown = tenth
            cells = " ".join(f"{rate:.0%}" for rate in rates)
            self.line(f"{snapshot.tick * TICK_S:8.1f} s  searched {cells}  real-time factor {factor:.1f}")

    def event(self, event: Event) -> None:
        if (line := event_line(event)) is not None:
            self.line(line)

    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None: ...

    def line(self, words: str) -> None:
        self._console.print(words, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None: ...
