"""Feeds the recorder of a station process with the station's view and with messages of world and robots."""

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

__all__ = ["Feeder"]

_POLL_S: Final = 0.2
_TOGETHER_TICKS: Final = 30
_TOGETHER_S: Final = 0.1
"""Ticks, or wall time, that are recorded at a time: one by one, each tick finds the caches cold."""


class Feeder:
    """Collects what is recorded.

    Messages of world and robots come by a session of its own, so that a station that hangs does not stop their senders.
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
        """Tick of the last snapshot."""
        self._views: list[StationView] = []
        """Views of ticks that are not recorded yet."""
        self._recorded_s = time.monotonic()
        self._session.subscribe(self._mailbox, keys.feed, keys.event)
        self._session.subscribe(self._mailbox, keys.table("*"), bounded=True)

    def take(self, station: Station) -> None:
        """Take the view of one tick, and from time to time record all that has come in."""
        self._views.append(station.view())
        if len(self._views) >= _TOGETHER_TICKS or time.monotonic() - self._recorded_s > _TOGETHER_S:
            self._drain()

    def rest(self) -> None:
        """Send all that is known to viewers, since no tick is under way."""
        self._drain()
        self._recorder.send()

    def catch_up(self, tick: int) -> None:
        """Record messages until the snapshot of `tick` is here, but do not wait for a lost one."""
        self._drain()
        until_s = time.monotonic() + LATE_STOP_S
        while self._tick < tick and (left_s := until_s - time.monotonic()) > 0.0 and self._session.connected():
            if (message := self._mailbox.get(min(left_s, _POLL_S))) is not None:
                self._record(message)

    def close(self) -> None:
        """Close the file.

        Raises:
            OSError: not all of it could be written.
        """
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
