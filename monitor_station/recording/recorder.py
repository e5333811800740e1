"""Writes the recording: what the MS knows (`ms/`), what the network does (`network/`), what is true (`truth/`).

Positions, lines, map tiles and forwarding tables wait for a moment and are sent as columns. What changes rarely is
logged at its exact tick. All calls must come from one thread.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

import rerun as rr

from agents.messages import Table
from monitor_station.config import RecorderConfig
from monitor_station.recording.blueprint import FEW_ROBOTS
from monitor_station.recording.known import Known
from monitor_station.recording.network import Network
from monitor_station.recording.scenery import write_static
from monitor_station.recording.stream import Rows, Stream
from monitor_station.recording.table_text import table_key, table_markdown
from monitor_station.recording.tiles import MapTiles
from monitor_station.view import StationView
from world.feed import Event, Snapshot
from world.terms import NOBODY

__all__ = ["Recorder"]

_HELD_TICKS: Final = 500
_HELD_WALL_S: Final = 1.5
"""Ticks, or wall time, after which rows are sent. The wall time bounds what a crash loses."""
_TABLE_PAUSE_TICKS: Final = 10
_TABLE_PAUSE_OF_MANY_TICKS: Final = 600
"""Shortest intervals between two forwarding tables of one robot, with few robots and with many."""
_EVENT_PATHS: Final = {"fault": "fault", "drop": "fault", "recovery": "fault", "link": "link", "role": "link"}


class Recorder:
    """One recording file, and on demand a live view of it on the loopback interface."""

    def __init__(self, config: RecorderConfig, path: Path, *, live_port: int | None = None) -> None:
        """Open the file and write what never changes.

        Raises:
            OSError: the file cannot be written.
        """
        self._stream = Stream(config, path, live_port)
        tiles = MapTiles(config.geometry)
        self._known = Known(self._stream, config, tiles)
        self._network = Network(self._stream, config)
        self._table_pause_ticks = _TABLE_PAUSE_TICKS if config.robots <= FEW_ROBOTS else _TABLE_PAUSE_OF_MANY_TICKS
        self._shown_tables: dict[int, tuple[int, bytes]] = {}
        """By robot: tick and key (`table_key`) of the forwarding table that the recording shows."""
        self._pages: dict[str, Rows] = {}
        """Forwarding tables that wait to be sent, as text, by path."""
        self._last_tick: int | None = None
        """Tick of the last snapshot."""
        self.dropped_ticks = 0
        """Ticks of the world's feed that never came; each gap is marked in `events/fault`."""
        self._sent_s = time.monotonic()
        self._closed = False
        write_static(self._stream, config, tiles.tiles)
        for tile in tiles.tiles:
            self._stream.log(0, f"ms/map/{tile.name}", rr.GridMap.from_fields(data=tiles.pixels(tile)))

    def station(self, view: StationView) -> None:
        """Record what the MS knows at a tick."""
        self._known.take(view)
        self._send_when_due()

    def snapshot(self, snapshot: Snapshot) -> None:
        """Record what the world knows at the end of a tick. Missing ticks are marked, old ones ignored."""
        tick, last = snapshot.tick, self._last_tick
        if last is not None and tick <= last:
            return
        if last is not None and tick > last + 1:
            self._mark_gap(last + 1, tick)
        self._last_tick = tick
        self._network.take(snapshot)
        self._send_when_due()

    def event(self, event: Event) -> None:
        """Write a line into the log of the mission, of the links or of the faults."""
        self._network.hear(event)
        where = _EVENT_PATHS.get(event.kind, "mission")
        level = "WARN" if where == "fault" else "INFO"
        self._stream.log(event.tick, f"events/{where}", rr.TextLog(event.text, level=level))

    def table(self, table: Table) -> None:
        """Show a robot's forwarding table, unless only locations have changed or the last one is too recent."""
        shown = self._shown_tables.get(table.node)
        if shown is not None and table.tick - shown[0] < self._table_pause_ticks:
            return
        key = table_key(table)
        if shown is not None and key == shown[1]:
            return
        self._shown_tables[table.node] = (table.tick, key)
        self._pages.setdefault(f"network/table/{table.node}", Rows()).add(table.tick, table_markdown(table))

    def send(self) -> None:
        """Send all rows that wait."""
        self._sent_s = time.monotonic()
        self._known.send()
        self._network.send()
        for path, rows in self._pages.items():
            if rows.ticks:
                kinds = [rr.MediaType.MARKDOWN] * len(rows.ticks)
                pages = rr.TextDocument.columns(text=rows.values, media_type=kinds)
                self._stream.send(path, rows, pages, lengths=[1] * len(rows.ticks))

    def close(self) -> None:
        """Write everything that waits and the file's footer; a second call does nothing.

        Raises:
            OSError: not all of the file could be written.
        """
        if self._closed:
            return
        self._closed = True
        self._known.close()
        self.send()
        self._stream.close()

    def _mark_gap(self, start: int, end: int) -> None:
        self.dropped_ticks += end - start
        text = f"{end - start} ticks of the world's feed were dropped ({self.dropped_ticks} so far)"
        self.event(Event(start, "drop", NOBODY, text))

    def _send_when_due(self) -> None:
        held_ticks = max(self._known.held_ticks, self._network.held_ticks)
        if held_ticks >= _HELD_TICKS or time.monotonic() - self._sent_s > _HELD_WALL_S:
            self.send()
