"""The monitor station as a process: keeps step as a node, keeps its journal, and feeds the recorder.

The recorder is fed after the step's outputs have been sent, so that it delays nobody who waits for this station.
"""

from __future__ import annotations

import functools
import logging
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgpack

from bus.member import END, Member, exit_status
from bus.session import Login
from medium.messages import Inbox, Transmission
from monitor_station.config import JOURNAL, MAP, RecorderConfig, StationConfig
from monitor_station.core import Station
from world.grid.map_file import save_map
from world.growing_file import GrowingFile
from world.messages import Sense
from world.seeds import node_stream
from world.terms import STATION
from world.unwritten import Unwritten

if TYPE_CHECKING:
    from monitor_station.recording.feeder import Feeder

__all__ = ["next_part", "run"]

RECORDING: Final = "recording.rrd"

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


class Shell:
    """Moves bytes between the bus, the core and the disk."""

    def __init__(
        self, config: StationConfig, login: Login, out: Path, recorder: RecorderConfig | None, live_port: int | None
    ) -> None:
        self._config, self._out = config, out
        self._journal: GrowingFile | None = None
        self._unwritten = Unwritten()
        self._feeder: Feeder | None = None
        # The member comes last: once its token is declared, the ticks may begin.
        self._recording = next_part(out)
        if recorder is not None:
            with self._unwritten.noting(self._recording.name):
                self._feeder = _feeder(login, recorder, self._recording, live_port)
        inbox_of = functools.partial(Inbox.decode, robots=config.node.robots)
        self._member = Member(login, "station", STATION, Sense.decode, inbox_of)
        if self._feeder is not None:
            self._member.idle = self._feeder.rest
        session = self._member.session
        self._put_final = session.publisher(session.keys.final("station"), blocking=True)

    def run(self) -> None:
        """All ticks; whatever ends them, the recording is closed.

        Raises:
            SystemExit: not all files could be written.
        """
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda *_: self._member.mailbox.put(END))
        try:
            self._ticks()
        finally:
            # The session closes first: without a launcher the medium waits for this token to drop before it ends.
            self._member.close()
            if self._feeder is not None:
                with self._unwritten.noting(self._recording.name):
                    self._feeder.close()
            if self._journal is not None:
                self._journal.close()
                if self._journal.error is not None:
                    self._unwritten.note(JOURNAL, self._journal.error)
        if self._unwritten.lines:
            sys.exit("; ".join(self._unwritten.lines))

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
            if self._journal is not None:
                self._journal.write(station.journal())
            member.answer(sense.tick, Transmission(sense.tick, STATION, frames).encode(), report.encode())
            if self._feeder is not None:
                self._feeder.take(station)
                member.phases.mark("recording")
        if self._feeder is not None and member.over:
            self._feeder.catch_up(last)
        if station is not None:
            with self._unwritten.noting(MAP):
                save_map(self._out / MAP, self._config.node.geometry, station.merger.cells)
        counts = station.final() if station is not None else {}
        malformed = member.malformed.count + (0 if self._feeder is None else self._feeder.malformed.count)
        self._put_final(msgpack.packb(counts | {"malformed": malformed}))

    def _start(self, sense: Sense) -> Station:
        """A new core, and its journal; after a restart it knows the reports that earlier incarnations acknowledged.

        The kernel keeps the journal if this process dies; only a power cut would lose it.
        """
        node = self._config.node
        rng = node_stream(node.seed, node.node, sense.incarnation)
        station = Station(self._config, rng, sense.incarnation, sense.tick)
        path = self._out / JOURNAL
        whole = 0
        if sense.incarnation > 0 and path.exists():
            whole = station.restore(path.read_bytes())
            log.info("back with %d scan reports from the journal", station.merger.merged)
        with self._unwritten.noting(JOURNAL):
            self._journal = GrowingFile(path, whole)
        return station


def next_part(out: Path) -> Path:
    """The file in which this process records: a restarted station goes on in recording-2.rrd, and so on."""
    path, part = out / RECORDING, 1
    while path.exists():
        part += 1
        path = out / RECORDING.replace(".", f"-{part}.")
    return path


def _feeder(login: Login, config: RecorderConfig, path: Path, live_port: int | None) -> Feeder:
    # Only a station that records needs Rerun.
    from monitor_station.recording.feeder import Feeder

    return Feeder(login, config, path, live_port)
