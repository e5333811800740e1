"""Feeds the recorder of a station process: the station's own view, and what world and robots tell for the recording."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

from agents.messages import Table
from bus.codec import WireError
from bus.malformed import Malformed
from bus.member import LATE_STOP_S
from bus.session import Login, Mailbox, Message, Session
from monitor_station.config import RecorderConfig
from monitor_station.core import Station
from monitor_station.recording.recorder import Recorder
from monitor_station.view import StationView
from world.feed import Event, unpack_feed
from world.terms import Cls

__all__ = ["Feeder", "next_part"]

RECORDING: Final = "recording.rrd"
_POLL_S: Final = 0.2
_TOGETHER_TICKS: Final = 30
_TOGETHER_S: Final = 0.1
"""So many ticks are recorded at a time, or those of so much wall time: one by one, each finds the caches cold."""


def next_part(out: Path) -> Path:
    """Where this process records: a station that was restarted goes on in recording-2.rrd, and so on."""
    path, part = out / RECORDING, 1
    while path.exists():
        part += 1
        path = out / RECORDING.replace(".", f"-{part}.")
    return path


class Feeder:
    """Brings together what is recorded.

    What world and robots tell comes by a session of its own: a station that hangs must not stop those who tell it.
    """

    def __init__(self, login: Login, config: RecorderConfig, path: Path, live_port: int | None) -> None:
        """Open the recording and listen.

        Raises:
            OSError: the file cannot be written.
            BusError: the router does not let the station in.
        """
        self._recorder = Recorder(config, path, live_port=live_port)
        self._mailbox = Mailbox()
        self._session = Session.connect(login, watching=True)
        keys = self._session.keys
        self._feed, self._event, self._node_of = keys.feed, keys.event, keys.node_of
        self.malformed = Malformed()
        self._tick = -1
        """Of the last snapshot."""
        self._views: list[StationView] = []
        """Of ticks that are not recorded yet."""
        self._recorded_s = time.monotonic()
        self._session.subscribe(self._mailbox, keys.feed, keys.event)
        self._session.subscribe(self._mailbox, keys.table("*"), bounded=True)

    def take(self, station: Station) -> None:
        """Take one tick, and from time to time record all that has come in."""
        self._views.append(station.view())
        if len(self._views) >= _TOGETHER_TICKS or time.monotonic() - self._recorded_s > _TOGETHER_S:
            self._drain()

    def rest(self) -> None:
        """No tick is under way: let viewers see all that is known."""
        self._drain()
        self._recorder.send()

    def catch_up(self, tick: int) -> None:
        """Record what is still under way, up to the snapshot of a tick, unless it was lost."""
        self._drain()
        until_s = time.monotonic() + LATE_STOP_S
        while self._tick < tick and (left_s := until_s - time.monotonic()) > 0.0 and self._session.connected():
            if (message := self._mailbox.get(min(left_s, _POLL_S))) is not None:
                self._record(message)

    def close(self) -> None:
        """Close the file."""
        self._session.close()
        self._drain()
        self._recorder.close()

    def _drain(self) -> None:
        self._recorded_s = time.monotonic()
        views, self._views = self._views, []
        for view in views:
            self._recorder.station(view)
        for message in self._mailbox.waiting():
            self._record(message)

    def _record(self, message: Message) -> None:
        key, data = message
        try:
            self._take(key, data or b"")
        except WireError as error:
            self.malformed.drop(f"message on {key}", error)

    def _take(self, key: str, data: bytes) -> None:
        if key == self._feed:
            for snapshot in unpack_feed(data):
                self._recorder.snapshot(snapshot)
                self._tick = snapshot.tick
        elif key == self._event:
            self._recorder.event(Event.decode(data))
        else:
            self._recorder.table(self._table(key, data))

    def _table(self, key: str, data: bytes) -> Table:
        table = Table.decode(data)
        if table.node != self._node_of(key) or (table.cls > max(Cls)).any():
            raise WireError("a table of another robot, or with a class that does not exist")
        return table
