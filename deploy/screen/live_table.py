"""What a person sees of a run: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from bus.nodes import process_name
from world.feed import Event, Snapshot
from world.terms import TICK_S, UNREACHABLE, Cls, Mode

__all__ = ["LiveTable", "PlainLines", "Silence", "View", "state_of"]

REFRESH_S: Final = 0.5
"""Seconds of wall time between two drawings."""

_STATES: Final = {Mode.INNER: "link to NMS", Mode.OUTER: "link to NMSR", Mode.LOST: "lost", Mode.WAIT: "waits"}
_STYLES: Final = {"search": "green", "relay": "cyan", "lost": "red", "gone": "red", "out": "yellow"}


class View(Protocol):
    """Somebody to show a run to. Called from one thread."""

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


def state_of(s: Snapshot, row: int, pids: Mapping[str, int] | None) -> str:
    """What a robot is doing, in one word or two."""
    if pids is not None and process_name(int(s.nodes[row])) not in pids:
        return "gone"
    if not s.present[row]:
        return "out"
    return _STATES.get(Mode(int(s.mode[row])), "relay" if s.cls[row] == Cls.RR else "search")


def _worth_a_line(event: Event) -> bool:
    """Not changes of class, which a table shows, nor the first routes, which every robot finds as the run begins."""
    return event.kind != "role" and not (event.kind == "link" and event.tick <= 1)


class _Clock:
    """Simulated time against wall time since the first snapshot."""

    def __init__(self) -> None:
        self._begun: float | None = None
        self._first = 0

    def factor(self, tick: int) -> float:
        now = time.monotonic()
        if self._begun is None:
            self._begun, self._first = now, tick
        passed = now - self._begun
        return (tick - self._first) * TICK_S / passed if passed > 0.05 else 0.0


class Silence:
    """Shows nothing."""

    def processes(self, pids: Mapping[str, int]) -> None: ...
    def snapshot(self, snapshot: Snapshot) -> None: ...
    def event(self, event: Event) -> None: ...
    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None: ...
    def line(self, words: str) -> None: ...
    def close(self) -> None: ...


class PlainLines:
    """Lines for a log: each event, and a progress line at every tenth of the search."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._clock = _Clock()
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
        if _worth_a_line(event):
            self.line(f"{event.tick * TICK_S:8.1f} s  {event.kind}: {event.text}")

    def phases(self, spent_s: Mapping[str, Mapping[str, float]]) -> None: ...

    def line(self, words: str) -> None:
        self._console.print(words, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None: ...


class LiveTable:
    """A table that is drawn in place, at most twice a second."""

    def __init__(self, console: Console, cells: Sequence[str], tallest: int = 40) -> None:
        self._cells = cells
        self._tallest = tallest
        self._clock = _Clock()
        self._pids: Mapping[str, int] | None = None
        self._latest: Snapshot | None = None
        self._phases: Mapping[str, Mapping[str, float]] = {}
        self._drawn_at = 0.0
        self._live = Live(console=console, auto_refresh=False)

    def processes(self, pids: Mapping[str, int]) -> None:
        self._pids = pids

    def snapshot(self, snapshot: Snapshot) -> None:
        self._clock.factor(snapshot.tick)
        self._latest = snapshot
        now = time.monotonic()
        if now - self._drawn_at >= REFRESH_S:
            self._drawn_at = now
            self._draw()

    def event(self, event: Event) -> None:
        if _worth_a_line(event):
            self.line(f"{event.tick * TICK_S:8.1f} s  {event.kind}: {event.text}")

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
            # Not before there is something to show: an empty place would leave an empty line after every line above.
            if not self._live.is_started:
                self._live.start()
            self._live.update(self._render(self._latest), refresh=True)

    def _render(self, s: Snapshot) -> RenderableType:
        factor = self._clock.factor(s.tick)
        head = Text(f"{s.tick * TICK_S:.1f} s simulated, real-time factor {factor:.1f}, {s.merged} scan reports merged")
        bars = Table.grid(padding=(0, 1))
        for name, rate in zip(self._cells, s.search_rate, strict=False):
            bars.add_row(_cell(name), ProgressBar(total=1.0, completed=rate, width=40), f"{rate:.0%}")
        return Group(self._robots(s), bars, head, *_blame(self._phases))

    def _robots(self, s: Snapshot) -> Table:
        table = Table("robot", "pid", "class", "hops", "NMS", "MSR", "state", box=None, pad_edge=False)
        for row in range(min(len(s.nodes), self._tallest)):
            node = int(s.nodes[row])
            state = state_of(s, row, self._pids)
            pid = "" if self._pids is None else str(self._pids.get(process_name(node), "-"))
            hops = "-" if s.hops[row] == UNREACHABLE else str(s.hops[row])
            cells = [str(node), pid, Cls(int(s.cls[row])).name, hops, _node(s.nms[row]), _node(s.msr[row])]
            table.add_row(*cells, Text(state, style=_STYLES.get(state, "")))
        if len(s.nodes) > self._tallest:
            table.add_row("...", "", "", "", "", "", f"{len(s.nodes) - self._tallest} more")
        return table


def _blame(phases: Mapping[str, Mapping[str, float]]) -> list[Text]:
    """Where the time of the ticks goes: one line for each kind of process, waiting left to the end."""
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


def _cell(name: str) -> str:
    return f"cell {name}" if name.isdigit() else name


def _node(node: int) -> str:
    return "-" if node < 0 else "MS" if node == 0 else str(node)
