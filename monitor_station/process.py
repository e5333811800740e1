"""The monitor station as a process: keeps step as a node, keeps its journal, and feeds the recorder.

The recorder is fed after the step's outputs have been sent, so that it delays nobody who waits for this station.
"""

from __future__ import annotations

import functools
import logging
import signal
import threading
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

import msgpack

from bus.member import END, Member, exit_status
from bus.session import Login
from medium.messages import Inbox, Transmission
from monitor_station.config import RecorderConfig, StationConfig
from monitor_station.core import Station
from world.grid.map_file import save_map
from world.messages import Sense
from world.seeds import node_stream
from world.terms import STATION

if TYPE_CHECKING:
    from monitor_station.recording.feeder import Feeder

__all__ = ["JOURNAL", "MAP", "run"]

JOURNAL: Final = "journal"
MAP: Final = "map.yaml"

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
    """What moves bytes around a station core."""

    def __init__(
        self, config: StationConfig, login: Login, out: Path, recorder: RecorderConfig | None, live_port: int | None
    ) -> None:
        self._config, self._out = config, out
        self._journal: IO[bytes] | None = None
        # First who listens, then the member: with its token the ticks may begin.
        self._feeder = None if recorder is None else _feeder(login, recorder, out, live_port)
        inbox_of = functools.partial(Inbox.decode, robots=config.node.robots)
        self._member = Member(login, "station", STATION, Sense.decode, inbox_of)
        if self._feeder is not None:
            self._member.idle = self._feeder.rest
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
            self._member.close()
            if self._feeder is not None:
                self._feeder.close()
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
            if self._feeder is not None:
                self._feeder.take(station)
                member.phases.mark("recording")
        if self._feeder is not None and member.over:
            self._feeder.catch_up(last)
        if station is not None:
            save_map(self._out / MAP, self._config.node.geometry, station.merger.cells)
        counts = station.final() if station is not None else {}
        malformed = member.malformed.count + (0 if self._feeder is None else self._feeder.malformed.count)
        self._put_final(msgpack.packb(counts | {"malformed": malformed}))

    def _start(self, sense: Sense) -> Station:
        """The core; after a restart, with what its predecessor had acknowledged."""
        node = self._config.node
        rng = node_stream(node.seed, node.node, sense.incarnation)
        station = Station(self._config, rng, sense.incarnation, sense.tick)
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


def _feeder(login: Login, config: RecorderConfig, out: Path, live_port: int | None) -> Feeder:
    # Only a station that records needs Rerun.
    from monitor_station.recording.feeder import Feeder, next_part

    return Feeder(login, config, next_part(out), live_port)
