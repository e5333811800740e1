"""A run as a table on a terminal, redrawn at the same spot."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from bus.nodes import process_name, short_name
from deploy.screen.view import Clock, event_line
from monitor_station.config import cell_title
from monitor_station.recording import palette
from monitor_station.recording.states import DisplayedStates
from world.feed import Event, Snapshot
from world.terms import TICK_S, UNREACHABLE, Cls

__all__ = ["LiveTable"]

REFRESH_S: Final = 0.5
"""Seconds of wall time between two drawings."""

_STYLES: Final = tuple(f"rgb({red},{green},{blue})" for red, green, blue in palette.STATE_COLORS)


class LiveTable:
    """A view that redraws its table at most twice a second."""

    def __init__(self, console: Console, cells: Sequence[str], tallest: int = 40) -> None:
        self._cells = cells
        self._tallest = tallest
        self._clock = Clock()
        self._pids: Mapping[str, int] | None = None
        """None in one process, where robots have no pid."""
        self._displayed = DisplayedStates()
        self._latest: Snapshot | None = None
        self._states: NDArray[np.int64] = np.zeros(0, np.int64)
        """Of the robots in the latest snapshot."""
        self._phases: Mapping[str, Mapping[str, float]] = {}
        self._drawn_at = 0.0
        self._live = Live(console=console, auto_refresh=False)

    def processes(self, pids: Mapping[str, int]) -> None:
        self._pids = pids

    def snapshot(self, snapshot: Snapshot) -> None:
        self._clock.factor(snapshot.tick)
        self._latest, self._states = snapshot, self._displayed.update(snapshot)
        now = time.monotonic()
        if now - self._drawn_at >= REFRESH_S:
            self._drawn_at = now
            self._draw()

    def event(self, event: Event) -> None:
        self._displayed.hear(event)
        if (line := event_line(event)) is not None:
            self.line(line)

    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None:
        self._phases = spent_s

    def line(self, words: str) -> None:
        self._live.console.print(words, markup=False, highlight=False)

    def close(self) -> None:
        self._draw()
        if self._live.is_started:
            self._live.stop()

    def _draw(self) -> None:
        if self._latest is not None:
            # Not before there is something to show: an empty table would leave an empty line after every line above it.
            if not self._live.is_started:
                self._live.start()
            self._live.update(self._render(self._latest), refresh=True)

    def _render(self, s: Snapshot) -> RenderableType:
        factor = self._clock.factor(s.tick)
        head = Text(f"{s.tick * TICK_S:.1f} s simulated, real-time factor {factor:.1f}, {s.merged} scan reports merged")
        bars = Table.grid(padding=(0, 1))
        for name, rate in zip(self._cells, s.search_rate, strict=False):
            bars.add_row(cell_title(name), ProgressBar(total=1.0, completed=rate, width=40), f"{rate:.0%}")
        return Group(self._robots(s), bars, head, *_blame(self._phases))

    def _robots(self, s: Snapshot) -> Table:
        table = Table("robot", "pid", "class", "hops", "NMS", "MSR", "state", box=None, pad_edge=False)
        for row in range(min(len(s.nodes), self._tallest)):
            node = int(s.nodes[row])
            state = int(self._states[row])
            pid = "" if self._pids is None else str(self._pids.get(process_name(node), "-"))
            hops = "-" if s.hops[row] == UNREACHABLE else str(s.hops[row])
            route = [hops, short_name(int(s.nms[row])), short_name(int(s.msr[row]))]
            shown = Text(palette.STATE_NAMES[state], style=_STYLES[state])
            table.add_row(str(node), pid, Cls(int(s.cls[row])).name, *route, shown)
        if len(s.nodes) > self._tallest:
            table.add_row("...", "", "", "", "", "", f"{len(s.nodes) - self._tallest} more")
        return table


def _blame(phases: Mapping[str, Mapping[str, float]]) -> list[Text]:
    """Shares of the time of ticks by phase, one line for each kind of process; waiting comes last."""
    kinds: dict[str, dict[str, float]] = {}
    for process, spent_s in phases.items():
        kind = kinds.setdefault(process.partition("-")[0], {})
        for phase, seconds in spent_s.items():
            kind[phase] = kind.get(phase, 0.0) + seconds
    lines = []
    for name, kind in sorted(kinds.items()):
        total = sum(kind.values()) or 1.0
        ranked = sorted(kind.items(), key=lambda item: (item[0] == "waiting", -item[1]))
        lines.append(Text(f"{name:8}" + "  ".join(f"{phase} {seconds / total:.0%}" for phase, seconds in ranked)))
    return lines
