"""The monitor station as a process: keeps step as a node, keeps its journal, and feeds the recorder.

The recorder is fed after the step's outputs have been sent, so that it delays nobody who waits for this station.
"""

from __future__ import annotations

import functools
import logging
import signal
import threading
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

import msgpack

from agents.messages import Table
from bus.codec import WireError
from bus.malformed import Malformed
from bus.member import END, LATE_STOP_S, Member, exit_status
from bus.session import Login, Mailbox, Message, Session
from medium.messages import Inbox, Transmission
from monitor_station.config import RecorderConfig, StationConfig
from monitor_station.core import Station
from world.feed import Event, unpack_feed
from world.map_file import save_map
from world.messages import Sense
from world.terms import STATION, Cls

if TYPE_CHECKING:
    from monitor_station.recording.recorder import Recorder
    from monitor_station.view import StationView

__all__ = ["JOURNAL", "MAP", "RECORDING", "run"]

RECORDING: Final = "recording.rrd"
JOURNAL: Final = "journal"
MAP: Final = "map.yaml"

_POLL_S: Final = 0.2

_TOGETHER_TICKS: Final = 30
_TOGETHER_S: Final = 0.1
"""So many ticks are recorded at a time, or those of so much wall time: one by one, each finds the caches cold."""

log = logging.getLogger(__name__)


def run(
    config: StationConfig, login: Login, recorder: RecorderConfig | None, out: Path, live_port: int | None = None
) -> None:
    """Run the station until the run ends; SIGTERM ends it in good order, its recording closed.

    Args:
        config: of the station's core.
        login: as the user `station`.
        recorder: what to record beside the streams; None = no recording.
        out: folder for the recording, the journal and, at the end, the merged map.
        live_port: serve the recording to viewers on this port, too.

    Raises:
        SystemExit: world, medium or router were lost or never there (status 3), or another living process is the
            station (status 4).
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    with exit_status():
        Shell(config, login, out, recorder, live_port).run()


def next_part(out: Path) -> Path:
    """Where this process records: a station that was restarted goes on in recording-2.rrd, and so on."""
    path, part = out / RECORDING, 1
    while path.exists():
        part += 1
        path = out / RECORDING.replace(".", f"-{part}.")
    return path


class Shell:
    """What moves bytes around a station core."""

    def __init__(
        self, config: StationConfig, login: Login, out: Path, recorder: RecorderConfig | None, live_port: int | None
    ) -> None:
        self._config, self._out = config, out
        self._journal: IO[bytes] | None = None
        # First who listens, then the member: with its token the ticks may begin.
        self._screen = None if recorder is None else Screen(login, recorder, next_part(out), live_port)
        inbox_of = functools.partial(Inbox.decode, robots=config.node.robots)
        self._member = Member(login, "station", STATION, Sense.decode, inbox_of)
        if self._screen is not None:
            self._member.idle = self._screen.rest
        session = self._member.session
        self._put_final = session.publisher(session.keys.final("station"), blocking=True)

    def run(self) -> None:
        """All ticks; whatever ends them, the recording is closed."""
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda *_: self._member.mailbox.put(END))
        try:
            self._ticks()
        finally:
            # The session first: without a launcher the router's host waits for this token to drop before it goes.
            self._member.session.close()
            if self._screen is not None:
                self._screen.close()
            if self._journal is not None:
                self._journal.close()

    def _ticks(self) -> None:
        member = self._member
        station: Station | None = None
        last = -1
        while (turn := member.turn()) is not None:
            sense, inbox = turn
            last = sense.tick
            if station is None:
                station = self._start(sense)
            frames, report = station.step(sense, inbox)
            member.phases.mark("step")
            self._keep(station.journal())
            member.answer(sense.tick, Transmission(sense.tick, STATION, frames).encode(), report.encode())
            if self._screen is not None:
                self._screen.show(station)
                member.phases.mark("recording")
        if self._screen is not None and member.over:
            self._screen.catch_up(last)
        if station is not None:
            save_map(self._out / MAP, self._config.node.geometry, station.merger.cells)
        counts = station.final() if station is not None else {}
        malformed = member.malformed.count + (0 if self._screen is None else self._screen.malformed.count)
        self._put_final(msgpack.packb(counts | {"malformed": malformed}))

    def _start(self, sense: Sense) -> Station:
        """The core; after a restart, with what its predecessor had acknowledged."""
        station = Station(self._config, sense.incarnation, sense.tick)
        path = self._out / JOURNAL
        whole = 0
        if sense.incarnation > 0 and path.exists():
            whole = station.restore(path.read_bytes())
            log.info("back with %d scan reports from the journal", station.merger.merged)
        self._journal = path.open("ab", buffering=0)
        self._journal.truncate(whole)
        return station

    def _keep(self, entry: bytes) -> None:
        """Hand the journal to the kernel, which keeps it if this process dies; only a power cut would lose it."""
        assert self._journal is not None
        while entry:
            entry = entry[self._journal.write(entry) :]


class Screen:
    """Feeds the recorder: the station's own view, and what world and robots tell for the recording only.

    That comes by a session of its own: a station that hangs must not stop those who tell it.
    """

    def __init__(self, login: Login, config: RecorderConfig, path: Path, live_port: int | None) -> None:
        # Only a station that records needs Rerun.
        from monitor_station.recording.recorder import Recorder

        self._recorder: Recorder = Recorder(config, path, live_port=live_port)
        self._mailbox = Mailbox()
        self._session = Session.connect(login, watching=True)
        keys = self._session.keys
        self._feed, self._event, self._node_of = keys.feed, keys.event, keys.node_of
        self.malformed = Malformed()
        self._tick = -1
        """Of the last snapshot."""
        self._views: list[StationView] = []
        """Ticks that are not recorded yet."""
        self._recorded_s = time.monotonic()
        self._session.subscribe(self._mailbox, keys.feed, keys.event, keys.table("*"))

    def show(self, station: Station) -> None:
        """Take one tick, and from time to time record all that has come in."""
        self._views.append(station.view())
        if len(self._views) >= _TOGETHER_TICKS or time.monotonic() - self._recorded_s > _TOGETHER_S:
            self._drain()

    def rest(self) -> None:
        """No tick is under way: show all that is known."""
        self._drain()
        self._recorder.send()

    def catch_up(self, tick: int) -> None:
        """Record what is still under way, up to the snapshot of a tick, unless it was lost."""
        self._drain()
        until_s = time.monotonic() + LATE_STOP_S
        while self._tick < tick and (left_s := until_s - time.monotonic()) > 0.0 and self._session.connected():
            self._record(self._mailbox.get(min(left_s, _POLL_S)))

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
        while (message := self._mailbox.get(0.0)) is not None:
            self._record(message)

    def _record(self, message: Message | None) -> None:
        if message is None:
            return
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
