"""One run as real processes: starts them, listens to the world, sends the signals that it orders, and ends them all.

The world is the judge of the run. The launcher decides nothing about ticks.
"""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import signal
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bus.member import LATE_STOP_S, LOST_STATUS
from bus.nodes import node_name, process_name
from bus.session import BusError, Put, Session, new_token
from deploy.failures import Failures, indented
from deploy.processes.fleet import Fleet
from deploy.processes.listener import Listener
from deploy.processes.operator_file import OPERATOR, write_operator
from deploy.processes.supervisor import Exit
from deploy.run_folder.summary import shortfall
from deploy.run_folder.writer import RunFolder
from world.feed import Absence, Signal
from world.own_file import write_whole
from world.terms import STATION

if TYPE_CHECKING:
    from deploy.screen.view import View

__all__ = ["Launcher", "Outcome"]

_SIGNALS: Final = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "cont": signal.SIGCONT}
_STATION: Final = process_name(STATION)

# Wall times.
_LEAVE_S: Final = 1.0 + LATE_STOP_S
"""For processes to end by themselves once world or medium is lost."""
_ANSWER_S: Final = 1.0
_INTERRUPT_S: Final = 2.0
"""For the world to end an interrupted run."""
_CLOSE_S: Final = 30.0
"""For processes to close their files after the world's last counts: a long recording takes a while."""
_STOP_GRACE_S: Final = 1.5
_RETURNS: Final = 3
_RETURNS_IN_S: Final = 10.0
"""A station that dies more often than `_RETURNS` times within this time is not started again."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    summary: dict[str, Any]
    failures: tuple[str, ...]
    """Of each process that failed one line, then its traceback or the end of its log, and who failed likewise; of
    each file that could not be written one line. Empty if the run ended as it should."""

    @property
    def exit_status(self) -> int:
        return 1 if self.failures else 0


class Launcher:
    """Carries one run of real processes from its start to its end. It serves one run."""

    def __init__(self, fleet: Fleet, folder: RunFolder, view: View) -> None:
        """Prepare a run of `fleet`. Its files go to `folder`; `view` shows what happens."""
        self._fleet = fleet
        self._folder = folder
        self._view = view
        self._supervisor = fleet.supervisor(folder.claim.lock)
        self._listener = Listener(folder, view, fleet.last_node, self._supervisor.wake)

        self._put_absence: Put | None = None

        # How the run ends.
        self._asked_to_stop = 0
        self._seen_stop = 0
        """How often `interrupt` was called, and to how many of these calls the launcher has reacted."""
        self._lost: str | None = None
        """Why the run can't go on."""
        self._failures = Failures()
        self._owing = {"world", "medium"}
        """Processes that send last counts if the run ends well."""
        self._give_up_at: float | None = None
        """Monotonic time at which the launcher stops the processes that are left."""

        # Whether a dead station is started again.
        self._sent_away: set[str] = set()
        """Processes that were killed by order of the world."""
        self._returns_s: deque[float] = deque(maxlen=_RETURNS)

    def interrupt(self) -> None:
        """End the run soon, or at the second call now. Signal handlers and other threads may call it."""
        self._asked_to_stop += 1
        self._supervisor.wake()

    def run(self) -> Outcome:
        """Run to the end, good or bad. No process is left when this returns."""
        begun = time.monotonic()
        # The session closes before the supervisor, which its threads wake.
        with self._supervisor, contextlib.ExitStack() as opened:
            self._fleet.start_all_but_last(self._supervisor)
            session = self._connect()
            if session is not None:
                opened.callback(session.close)
                with self._folder.unwritten.noting(OPERATOR):
                    write_operator(self._folder.path, self._fleet.operator)
                opened.callback((self._folder.path / OPERATOR).unlink, missing_ok=True)
                self._put_absence = session.publisher(session.keys.absence, blocking=True)
                self._listener.listen(session)
                # The medium hosts the router, and stays until this token drops.
                session.declare(new_token("operator"))
                # The world waits for every robot, so nothing was published before the launcher listened.
                self._start_last(opened)
                self._show_pids()
                self._attend(session)
            self._ends(self._supervisor.stop(_STOP_GRACE_S), expected=True)
        self._listener.take()  # its signals come too late: no process is left
        self._view.close()
        return self._outcome(time.monotonic() - begun)

    def _start_last(self, opened: contextlib.ExitStack) -> None:
        """Start what the run still lacks; say what external robots need, which goes when `opened` closes."""
        fleet = self._fleet
        for node in fleet.external:
            opened.callback(fleet.credentials_file(node).unlink, missing_ok=True)
        with self._folder.unwritten.noting("credentials of external robots"):
            fleet.start_last(self._supervisor)
        for node in fleet.external:
            file = fleet.credentials_file(node)
            self._view.line(
                f"{node_name(node)} is external: start a process of it within {fleet.patience_s:g} s that logs in with "
                f"{file} (docs/wire.md), such as: python -m agents --credentials {shlex.quote(str(file))}"
            )

    def _show_pids(self) -> None:
        pids = {"launcher": os.getpid(), **self._supervisor.pids}
        with self._folder.unwritten.noting("pids.json"):
            write_whole(self._folder.path / "pids.json", json.dumps(pids, indent=1) + "\n")
        self._view.processes(self._supervisor.pids)

    def _connect(self) -> Session | None:
        """Log in as the operator, in a thread, so that a failed medium and Ctrl-C are noticed meanwhile."""
        opened: list[Session | Exception] = []

        def connect() -> None:
            try:
                opened.append(Session.connect(self._fleet.operator, watching=True))
            except Exception as error:  # whatever it is, who waits for this thread must learn of it
                opened.append(error)
            self._supervisor.wake()

        threading.Thread(target=connect, name="log in", daemon=True).start()
        while not opened:
            if self._lost or self._asked_to_stop:
                return None
            self._ends(self._supervisor.wait())
        if isinstance(opened[0], Exception):
            self._lose(f"the launcher could not join the run: {opened[0]}")
            return None
        return opened[0]

    def _attend(self, session: Session) -> None:
        """Carry the run to its end."""
        supervisor = self._supervisor
        while supervisor.pids:
            if self._asked_to_stop > self._seen_stop:
                self._stop_asked(session)
            left = None if self._give_up_at is None else max(0.0, self._give_up_at - time.monotonic())
            if left == 0.0:
                return
            self._ends(supervisor.wait(left))
            self._listen()
            if self._owing <= self._listener.finals.keys() and not {"world", _STATION} & supervisor.pids.keys():
                if supervisor.pids.keys() == {"medium"}:
                    session.close()
                else:
                    self._give_up_in(_LEAVE_S)  # a robot that started too late to hear the stop

    def _listen(self) -> None:
        """Read the messages that have come in, and act on them."""
        over = self._over
        for order in self._listener.take():
            self._carry_out(order)
        if self._over and not over:
            # All processes close their files now. For that, stopped ones are continued.
            for name in self._supervisor.pids:
                self._supervisor.signal(name, signal.SIGCONT)
            self._give_up_at = None if self._give_up_at is None else time.monotonic() + _INTERRUPT_S
            self._give_up_in(_CLOSE_S)

    def _carry_out(self, order: Signal) -> None:
        name = process_name(order.node)
        if order.verb == "spawn":
            self._start_again(order.node)
        elif order.verb == "look":
            self._look(order.node)
        else:
            if order.verb == "kill":
                self._sent_away.add(name)
            self._supervisor.signal(name, _SIGNALS[order.verb])

    def _look(self, node: int) -> None:
        """Tell the world if the process that it waits for is dead or stopped."""
        if node in self._fleet.external:
            return  # nobody here knows; the world waits for its deadline
        name = process_name(node)
        dead = name not in self._supervisor.pids
        if self._put_absence is not None and (dead or self._supervisor.stopped(name)):
            self._put_absence(Absence(node, dead).encode())

    def _start_again(self, node: int) -> None:
        self._supervisor.end(process_name(node))
        self._sent_away.discard(process_name(node))
        self._fleet.start(self._supervisor, node)
        self._show_pids()

    # The end

    @property
    def _over(self) -> bool:
        """Whether the last counts of the world are here."""
        return "world" in self._listener.finals

    def _stop_asked(self, session: Session) -> None:
        self._seen_stop = self._asked_to_stop
        if self._seen_stop > 1 or self._lost or self._over:
            self._give_up_in(0.0)
            return
        self._view.line("interrupted: ending the run")
        with contextlib.suppress(BusError):
            session.ask(session.keys.control, "interrupt", timeout_s=_ANSWER_S)
        self._give_up_in(_INTERRUPT_S)

    def _give_up_in(self, seconds: float) -> None:
        """Stop the processes that are left after `seconds`, or at an earlier deadline if there is one."""
        at = time.monotonic() + seconds
        self._give_up_at = at if self._give_up_at is None else min(self._give_up_at, at)

    def _ends(self, ends: list[Exit], *, expected: bool = False) -> None:
        """React to the ends of processes; `expected`: the launcher ended them."""
        # A process that ended because another was lost comes after that other.
        for end in sorted(ends, key=lambda end: end.code == LOST_STATUS):
            if end.words:
                self._failures.add(f"{end.name}: {end.words}")
            # Whoever asks this launcher to end may ask the whole process group; the others are lost then.
            if self._asked_to_stop and end.code in (-signal.SIGTERM, LOST_STATUS):
                continue
            if expected or end.code == 0:
                # A station that was killed or never came owes nothing.
                if end.name == _STATION:
                    self._owing.add(end.name)
                continue
            if end.name in ("world", "medium"):
                self._lose(str(end), end)
            elif not end.by_signal and end.code != LOST_STATUS and self._lost is None:
                self._fail(str(end), end)
            elif end.name == _STATION and self._may_return(end):
                self._view.line(f"{end}; it is started again")
                self._start_again(STATION)
            elif self._lost is None:
                self._view.line(str(end))
        if any(end.name == "world" for end in ends):
            self._give_up_in(_CLOSE_S if self._over else _LEAVE_S)
        if ends and not expected:
            if not {"world", "medium", _STATION} & self._supervisor.pids.keys():
                self._give_up_in(_LEAVE_S)
            if not self._over:
                self._view.processes(self._supervisor.pids)

    def _may_return(self, end: Exit) -> bool:
        """Whether to start the station again: it was killed, though not by order of the world, and the run goes on."""
        leaving = self._lost is not None or self._asked_to_stop or self._over
        if not end.by_signal or leaving or end.name in self._sent_away:
            return False
        now_s = time.monotonic()
        if len(self._returns_s) == _RETURNS and now_s - self._returns_s[0] < _RETURNS_IN_S:
            self._fail(f"{end.name} died {_RETURNS + 1} times within {_RETURNS_IN_S:g} s", end)
            return False
        self._returns_s.append(now_s)
        return True

    def _fail(self, words: str, end: Exit | None = None) -> None:
        """Note a failure: of a process that has ended with the exception that ended it, or the end of its log."""
        self._view.line(words)
        if end is not None and end.crash is not None:
            self._failures.crashed(end.name, words, end.crash)
            return
        self._failures.add(words if end is None else self._with_log(words, end.name))

    def _with_log(self, words: str, name: str) -> str:
        tail = self._supervisor.tail(name)
        return f"{words}\n{indented(tail)}" if tail else f"{words} (its log is empty)"

    def _lose(self, words: str, end: Exit | None = None) -> None:
        """The run can't go on."""
        if self._lost is None and not self._over:
            self._lost = words
            self._fail(words, end)
            self._give_up_in(_LEAVE_S)

    def _outcome(self, wall_s: float) -> Outcome:
        status: str | None = None
        if not self._over and self._asked_to_stop and not self._lost:
            status = "interrupted"
        elif not self._over:
            status = "failed"
            if not self._failures:
                self._failures.add(self._with_log("the world ended without its last word", "world"))
        summary = self._folder.finish(self._listener.finals, wall_s, status=status, failures=self._failures.lines)
        if (words := shortfall(summary)) is not None and not self._failures:
            self._failures.add(words)
        return Outcome(summary, (*self._failures.lines, *self._folder.unwritten.lines))
