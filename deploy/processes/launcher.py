"""One run as real processes: starts them, listens to the world, sends the signals that it asks for, and ends them all.

The world is the judge of the run; the launcher only carries out: it decides nothing about ticks.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import signal
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgpack

from bus.access import credentials, users_of
from bus.codec import WireError
from bus.keys import Keys, check_run
from bus.member import LATE_STOP_S, LOST_STATUS
from bus.nodes import process_name, user_name
from bus.phases import decode_phases
from bus.session import BusError, Mailbox, Session, new_token
from deploy.processes.entry import PRELOAD, run_medium, run_robot, run_station, run_world
from deploy.processes.operator_file import OPERATOR, write_operator
from deploy.processes.processors import places, shared
from deploy.processes.supervisor import Exit, Supervisor
from deploy.run_folder.writer import RunFolder
from world.feed import Event, Signal, unpack_feed
from world.own_file import write_whole
from world.terms import STATION, TICK_S

if TYPE_CHECKING:
    from deploy.scenario import Scenario
    from deploy.screen.view import View

__all__ = ["Launcher", "Outcome", "run_name"]

_SIGNALS: Final = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "cont": signal.SIGCONT}
_LEAVE_S: Final = 1.0 + LATE_STOP_S
"""Wall time in which processes leave by themselves once world or medium is lost."""
_ANSWER_S: Final = 1.0
_INTERRUPT_S: Final = 2.0
"""Wall time in which the world ends an interrupted run."""
_STOP_GRACE_S: Final = 1.5
_RETURNS: Final = 3
_RETURNS_IN_S: Final = 10.0
"""A station that dies more often than that within so much wall time is not started again."""
_CLOSE_S: Final = 30.0
"""Wall time in which processes close their files after the world's last word: a long recording takes a while."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    summary: dict[str, Any]
    failures: tuple[str, ...]
    """Processes that failed, one line each, then the end of its log; and files that could not be written. Empty if the
    run ended as asked."""

    @property
    def exit_status(self) -> int:
        return 1 if self.failures else 0


def run_name(folder: Path) -> str:
    """A run's name as a key chunk, after its folder."""
    name = "".join("-" if c in "/*$?#@" or c.isspace() or not c.isprintable() else c for c in folder.resolve().name)
    return check_run(name or "run")


class Launcher:
    """Runs one scenario with one process per node."""

    def __init__(
        self,
        scenario: Scenario,
        folder: RunFolder,
        endpoint: str,
        view: View,
        *,
        record: bool = True,
        live_port: int | None = None,
        held: bool = False,
        plain_scheduling: bool = False,
    ) -> None:
        """Prepare a run.

        Args:
            scenario: what to run.
            folder: where its files go.
            endpoint: of the router.
            view: who is shown what happens.
            record: leave a recording.
            live_port: serve the recording to viewers on this port, too.
            held: begin held, as by the operator's `hold`.
            plain_scheduling: leave it to the kernel where processes run.
        """
        self._scenario = scenario
        self._folder = folder
        self._view = view
        self._record = record
        self._live_port = live_port
        self._held = held
        nodes = [process_name(node) for node in range(scenario.robots + 1)]
        processors = () if plain_scheduling else shared(len(nodes) + len(("world", "medium")))
        self._places = places(processors, nodes)
        self._recording_id = str(uuid.uuid4())
        self._sent_away: set[str] = set()
        """Processes that the world had killed."""
        self._returns_s: deque[float] = deque(maxlen=_RETURNS)
        self._run = run_name(folder.path)
        self._logins = credentials(self._run, endpoint, scenario.robots)
        self._supervisor: Supervisor | None = None
        self._mail: deque[tuple[str, bytes]] = deque()
        self._finals: dict[str, dict[str, Any]] = {}
        self._owed = {"world", "medium"}
        """Those whose final counts are still to come if the run ends well."""
        self._failures: list[str] = []
        self._lost: str | None = None
        self._asked_to_stop = 0
        self._seen_stop = 0
        self._give_up_at: float | None = None

    def interrupt(self) -> None:
        """End the run soon; callable from a signal handler or another thread. Twice: at once."""
        self._asked_to_stop += 1
        if self._supervisor is not None:
            self._supervisor.wake()

    @property
    def pids(self) -> Mapping[str, int]:
        """Living processes by name: world, medium, station, robot/1, ..."""
        return {} if self._supervisor is None else self._supervisor.pids

    def run(self) -> Outcome:
        """Run to the end, whatever the end is. No process is left when this returns."""
        begun = time.monotonic()
        operator = self._folder.path / OPERATOR
        session: Session | None = None
        pump: _Pump | None = None
        try:
            lock = self._folder.claim.lock
            with Supervisor(self._run, self._folder.path / "logs", PRELOAD, self._places, lock) as self._supervisor:
                self._start_all_but_one(self._supervisor)
                session = self._connect(self._supervisor)
                if session is not None:
                    with self._folder.unwritten.noting(OPERATOR):
                        write_operator(self._folder.path, self._logins["operator"])
                    pump = _Pump(session, self._mail, self._supervisor.wake)
                    # The medium, which hosts the router, stays until this token drops.
                    session.declare(new_token("operator"))
                    # The world waits for every robot, so with the last one nothing is told before somebody listens.
                    self._start_node(self._supervisor, self._scenario.robots)
                    self._show_pids(self._supervisor)
                    self._attend(self._supervisor, session)
                self._ends(self._supervisor.stop(_STOP_GRACE_S), expected=True)
                if pump is not None:
                    pump.end()
        finally:
            self._supervisor = None
            operator.unlink(missing_ok=True)
            if session is not None:
                session.close()
        self._take_mail()
        self._view.close()
        return self._outcome(time.monotonic() - begun)

    def _start_all_but_one(self, supervisor: Supervisor) -> None:
        users = users_of(self._logins)
        supervisor.start("medium", run_medium, self._scenario.medium_config(), self._logins["medium"], users)
        world = dataclasses.replace(self._scenario.world_config(), held=self._held)
        supervisor.start("world", run_world, world, self._logins["world"])
        for node in range(self._scenario.robots):
            self._start_node(supervisor, node)

    def _start_node(self, supervisor: Supervisor, node: int) -> None:
        login = self._logins[user_name(node)]
        if node != STATION:
            supervisor.start(process_name(node), run_robot, self._scenario.robot_config(node), login)
            return
        recorder = None
        if self._record:
            recorder = dataclasses.replace(self._scenario.recorder_config(self._run), recording_id=self._recording_id)
        station = self._scenario.station_config()
        supervisor.start(process_name(node), run_station, station, login, recorder, self._folder.path, self._live_port)

    def _show_pids(self, supervisor: Supervisor) -> None:
        pids = {"launcher": os.getpid(), **supervisor.pids}
        with self._folder.unwritten.noting("pids.json"):
            write_whole(self._folder.path / "pids.json", json.dumps(pids, indent=1) + "\n")
        self._view.processes(supervisor.pids)

    def _connect(self, supervisor: Supervisor) -> Session | None:
        """Log in as the operator, in a thread: a medium that failed or a Ctrl-C must not have to wait for that."""
        opened: list[Session | Exception] = []

        def connect() -> None:
            try:
                opened.append(Session.connect(self._logins["operator"], watching=True))
            except Exception as error:  # whatever it is, who waits for this thread must learn of it
                opened.append(error)
            supervisor.wake()

        threading.Thread(target=connect, name="log in", daemon=True).start()
        while not opened:
            if self._lost or self._asked_to_stop:
                return None
            self._ends(supervisor.wait())
        if isinstance(opened[0], Exception):
            self._lose(f"the launcher could not join the run: {opened[0]}")
            return None
        return opened[0]

    def _attend(self, supervisor: Supervisor, session: Session) -> None:
        """Carry the run to its end."""
        while supervisor.pids:
            if self._asked_to_stop > self._seen_stop:
                self._stop_asked(session)
            left = None if self._give_up_at is None else max(0.0, self._give_up_at - time.monotonic())
            if left == 0.0:
                return
            self._ends(supervisor.wait(left))
            self._take_mail()
            if not self._owed and not {"world", process_name(STATION)} & supervisor.pids.keys():
                if supervisor.pids.keys() == {"medium"}:
                    session.close()
                else:
                    self._give_up_in(_LEAVE_S)  # a robot that came too late to hear the stop

    def _stop_asked(self, session: Session) -> None:
        self._seen_stop = self._asked_to_stop
        if self._seen_stop > 1 or self._lost or "world" in self._finals:
            self._give_up_in(0.0)
            return
        self._view.line("interrupted: ending the run")
        with contextlib.suppress(BusError):
            session.ask(session.keys.control, "interrupt", timeout_s=_ANSWER_S)
        self._give_up_in(_INTERRUPT_S)

    def _give_up_in(self, seconds: float) -> None:
        """Stop whoever is still there after that time; an earlier deadline stays."""
        at = time.monotonic() + seconds
        self._give_up_at = at if self._give_up_at is None else min(self._give_up_at, at)

    def _ends(self, ends: list[Exit], *, expected: bool = False) -> None:
        # Those that were lost for want of another come after that other.
        for end in sorted(ends, key=lambda end: end.code == LOST_STATUS):
            if end.words:
                self._failures.append(f"{end.name}: {end.words}")
            # Whoever asks this launcher to end may ask the whole process group; the others are lost then.
            if self._asked_to_stop and end.code in (-signal.SIGTERM, LOST_STATUS):
                continue
            if expected or end.code == 0:
                # One that was killed or never came owes nothing.
                if end.name == process_name(STATION) and end.name not in self._finals:
                    self._owed.add(end.name)
                continue
            if end.name in ("world", "medium"):
                self._lose(str(end), end.name)
            elif not end.by_signal and end.code != LOST_STATUS and self._lost is None:
                self._fail(str(end), end.name)
            elif end.name == process_name(STATION) and self._may_return(end):
                self._view.line(f"{end}; it is started again")
                self._start_again(STATION)
            elif self._lost is None:
                self._view.line(str(end))
        if ends and self._supervisor is not None:
            if not {"world", "medium", "station"} & self._supervisor.pids.keys():
                self._give_up_in(_LEAVE_S)
            if "world" not in self._finals:
                self._view.processes(self._supervisor.pids)

    def _may_return(self, end: Exit) -> bool:
        """Whether the station is started again: it was killed, but not by the world's order, and the run goes on."""
        over = self._lost is not None or self._asked_to_stop or "world" in self._finals
        if not end.by_signal or over or end.name in self._sent_away:
            return False
        now_s = time.monotonic()
        if len(self._returns_s) == _RETURNS and now_s - self._returns_s[0] < _RETURNS_IN_S:
            self._fail(f"{end.name} died {_RETURNS + 1} times within {_RETURNS_IN_S:g} s", end.name)
            return False
        self._returns_s.append(now_s)
        return True

    def _start_again(self, node: int) -> None:
        if self._supervisor is not None:
            self._supervisor.end(process_name(node))
            self._sent_away.discard(process_name(node))
            self._start_node(self._supervisor, node)
            self._show_pids(self._supervisor)

    def _fail(self, words: str, name: str | None = None) -> None:
        self._view.line(words)
        if name is not None and self._supervisor is not None:
            tail = self._supervisor.tail(name)
            words += f"\n{_indent(tail)}" if tail else " (its log is empty)"
        self._failures.append(words)

    def _lose(self, words: str, name: str | None = None) -> None:
        """The run can't go on."""
        if self._lost is None and "world" not in self._finals:
            self._lost = words
            self._fail(words, name)
            self._give_up_in(_LEAVE_S)

    def _take_mail(self) -> None:
        while self._mail:
            key, payload = self._mail.popleft()
            kind, rest = Keys.kind_of(key)
            try:
                self._receive(kind, rest, payload)
            except WireError as error:
                self._view.line(f"dropped a malformed {kind}: {error}")

    def _receive(self, kind: str, rest: str, payload: bytes) -> None:
        if kind == "feed":
            for snapshot in unpack_feed(payload):
                self._folder.snapshot(snapshot)
                self._view.snapshot(snapshot)
        elif kind == "event":
            event = Event.decode(payload)
            self._folder.event(event)
            self._view.event(event)
        elif kind == "phases":
            self._take_phases(rest, decode_phases(payload))
        elif kind == "signal":
            self._carry_out(Signal.decode(payload))
        elif kind == "final":
            try:
                self._finals[rest] = msgpack.unpackb(payload, strict_map_key=False)
            except (ValueError, msgpack.UnpackException) as error:
                raise WireError(f"not msgpack: {error}") from error
            self._owed.discard(rest)
            if rest == "world":
                self._world_ended()

    def _take_phases(self, process: str, spent_s: dict[str, float]) -> None:
        phases = self._finals.setdefault("phases", {})
        phases[process] = spent_s
        self._view.phases(phases)

    def _world_ended(self) -> None:
        """Everybody closes his files now; who was stopped is continued for that."""
        if self._supervisor is not None:
            for name in self._supervisor.pids:
                self._supervisor.signal(name, signal.SIGCONT)
        self._give_up_at = None if self._give_up_at is None else time.monotonic() + _INTERRUPT_S
        self._give_up_in(_CLOSE_S)

    def _carry_out(self, order: Signal) -> None:
        supervisor, name = self._supervisor, process_name(order.node)
        if supervisor is None:
            return
        if order.verb == "spawn":
            self._start_again(order.node)
            return
        if order.verb == "kill":
            self._sent_away.add(name)
        supervisor.signal(name, _SIGNALS[order.verb])

    def _outcome(self, wall_s: float) -> Outcome:
        status: str | None = None
        if "world" not in self._finals and self._asked_to_stop and not self._lost:
            status = "interrupted"
        elif "world" not in self._finals:
            status = "failed"
            if not self._failures:
                self._failures.append("the world ended without its last word")
        summary = self._folder.finish(self._finals, wall_s, status=status, failures=self._failures)
        if summary["status"] == "failed" and not self._failures:
            self._failures.append(f"the world ended the run as failed at {summary['ticks'] * TICK_S:.1f} s")
        return Outcome(summary, (*self._failures, *self._folder.unwritten.lines))


class _Pump:
    """Moves what arrives over the bus to the launcher's thread, and wakes it."""

    def __init__(self, session: Session, mail: deque[tuple[str, bytes]], wake: Callable[[], None]) -> None:
        self._mail = mail
        self._wake = wake
        self._box = Mailbox()
        keys = session.keys
        session.subscribe(self._box, keys.feed, keys.event, keys.signal, keys.final("*"), keys.phases("*"))
        self._thread = threading.Thread(target=self._run, name="pump", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            message = self._box.get(3600.0)
            if message is None:
                continue
            key, payload = message
            if payload is None:
                return
            self._mail.append((key, payload))
            self._wake()

    def end(self) -> None:
        """Take what has arrived so far, then stop."""
        self._box.put(("", None))
        self._thread.join()


def _indent(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.splitlines())
