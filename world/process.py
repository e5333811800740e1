"""The world as a process: paces the ticks, moves bytes, and notices who is there, silent or gone.

What follows from that (who takes part, which fault acts, when the run ends) is the core's to decide.
"""

from __future__ import annotations

import json
import logging
import signal
import threading
import time
from collections.abc import Mapping
from typing import Any, Final, Protocol

import msgpack

from bus.codec import WireError
from bus.envelopes import NO_TICK, Moves, Opening
from bus.lockstep import Gather, Kind, Patience, batch, seal
from bus.member import LostError, exit_status
from bus.phases import REPORT_TICKS, Phases
from bus.session import Login, Mailbox, Message, Session, new_token
from world.attendance import Attendance
from world.config import Fault, WorldConfig
from world.core import Begin, Told, World
from world.faults import check_fault, parse_fault
from world.messages import STATION, TICK_S, Departed, Event, Motion, Report, Snapshot, Stop
from world.pace import Pace
from world.stopwatch import Stopwatch

__all__ = ["run"]

FEED_TICKS: Final = 10
"""Snapshots that one message of the feed carries."""

_BY_HAND: Final = "by hand"
"""Stands for a key on faults that the operator ordered: no key has a space."""

log = logging.getLogger(__name__)


def run(config: WorldConfig, login: Login) -> None:
    """Run the world until the run ends.

    SIGTERM interrupts the run: everybody gets a `Stop`.

    Raises:
        SystemExit: the router can't be reached, or was lost (status 3).
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    with exit_status():
        Shell(World(config), config, login).run()


class Core(Protocol):
    """What the shell drives: `world.core.World`, or one that does nothing, to measure the shell alone."""

    tick: int

    def awaited(self) -> frozenset[int]: ...
    def arrive(self, node: int, *, new: bool) -> None: ...
    def depart(self, node: int, cause: str, *, counted: bool) -> None: ...
    def inject(self, fault: Fault) -> None: ...
    def begin(self) -> Begin: ...
    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None: ...
    def tell(self) -> Told: ...
    def interrupt(self) -> None: ...
    def fail(self, why: str) -> Stop: ...
    def final(self) -> dict[str, Any]: ...


class _RunError(Exception):
    """The run can't go on; the words say why."""


class Shell:
    """What moves bytes around a world core."""

    def __init__(self, core: Core, config: WorldConfig, login: Login) -> None:
        self._core, self._config = core, config
        self._session = Session.connect(login)
        self._mailbox = Mailbox()
        self._attendance = Attendance()
        self._pace = Pace(config.speed, time.monotonic, held=config.held)
        self._stopwatch = Stopwatch()
        self._phases = Phases(time.perf_counter)
        self._gather: Gather[Motion | Report] = Gather(-1, ())
        self._complete = NO_TICK
        """The last tick for which the medium waits for nobody any more."""
        self._counted: frozenset[int] = frozenset()
        """Whose transmission counted in it."""
        self._untold = False
        """A tick has ended of which nobody has heard."""
        self._asked: Patience | None = None
        """Since when the medium owes an answer."""
        self._pongs = 0
        self._heard_s = time.monotonic()
        """When something came in last."""
        self._leaving: dict[int, tuple[int, str]] = {}
        """(token, cause) of who left during the tick, until the medium has told whether they still counted."""
        self._mediums: set[str] = set()
        self._medium_lost = False
        self._snapshots: list[Snapshot] = []
        self._last: Snapshot | None = None
        self._dropped = 0
        self._nodes = range(config.robots + 1)
        self._open()

    def run(self) -> None:
        """All ticks, then the end."""
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda _number, _frame: self._pace.interrupt())
        with self._session:
            try:
                stop = self._ticks()
            except _RunError as failure:
                log.error("the run failed at %.1f s: %s", self._core.tick * TICK_S, failure)
                stop = self._core.fail(str(failure))
                self._tell(STATION, f"the run failed: {failure}")
            self._finish(stop)

    def _open(self) -> None:
        session, keys = self._session, self._session.keys
        self._put_words = [session.publisher(keys.word(node), blocking=True) for node in self._nodes]
        self._put_positions = session.publisher(keys.positions, blocking=True)
        self._put_signal = session.publisher(keys.signal, blocking=True)
        self._put_final = session.publisher(keys.final("world"), blocking=True)
        self._put_phases = session.publisher(keys.phases("world"), blocking=False)
        self._put_feed = session.publisher(keys.feed, blocking=False)
        self._put_event = session.publisher(keys.event, blocking=False)
        self._pong_key, self._moved_key = keys.pong, keys.moved
        session.subscribe(self._mailbox, keys.moved, keys.pong)
        session.watch(self._mailbox, *(keys.alive(role) for role in ("medium", "station", "robot")))
        session.answer(keys.control, self._command)
        session.declare(new_token("world"))

    def _command(self, line: str) -> str:
        """Answer the operator, in a thread of the session's: a fault is checked here and acts in the world's own."""
        word, _, rest = line.partition(" ")
        if word != "fault":
            return self._pace.command(line, self._status)
        try:
            check_fault(parse_fault(rest), self._config.robots)
        except ValueError as error:
            return json.dumps({"error": str(error)})
        self._mailbox.put((_BY_HAND, rest.encode()))
        return json.dumps(self._status() | {"fault": rest})

    def _status(self) -> dict[str, Any]:
        """For an operator: the next tick, or the one that is under way, who is waited for, and how far the run is."""
        last = self._last
        return {
            "tick": self._core.tick,
            "ticking": self._gather.tick == self._core.tick,
            "waiting_for": [_name(node) for node in sorted(self._gather.missing)],
            "robots": [] if last is None else last.nodes[last.present == 1].tolist(),
            "search_rate": [] if last is None else list(last.search_rate),
        }

    # One tick

    def _ticks(self) -> Stop:
        core = self._core
        while True:
            if not self._ready():
                core.interrupt()
                return Stop(core.tick, "interrupted")
            started_s = time.perf_counter()
            self._phases.skip()
            begin = core.begin()
            self._phases.mark("step")
            self._pace.began()
            self._send(begin)
            self._phases.mark("encode")
            sent_s = time.perf_counter()
            self._publish()  # while the others are at work
            moved_s = self._collect(begin)
            done_s = time.perf_counter()
            stop = self._end()
            self._phases.mark("step")
            if begin.tick % REPORT_TICKS == 0:
                self._put_phases(self._phases.encode())
            last = None if self._gather.last is None else _name(self._gather.last).replace(" ", "-")
            self._stopwatch.tick(started_s, sent_s, moved_s, done_s, time.perf_counter(), last)
            if stop is not None:
                self._publish()
                return stop

    def _ready(self) -> bool:
        """Wait until the next tick may begin; False if the run was interrupted while somebody is awaited."""
        patience = Patience(time.monotonic())
        while True:
            for node, new in self._attendance.arrivals():
                self._core.arrive(node, new=new)
            awaited = self._core.awaited()
            if awaited or not self._mediums:
                self._publish()
                if self._pace.interrupted:
                    return False
                self._receive(Patience.SLICE_S)
                if patience.wait(time.monotonic()) > self._config.return_deadline_s:
                    absent = [_name(node) for node in sorted(awaited)] + ["medium"] * (not self._mediums)
                    raise _RunError(f"not there within {self._config.return_deadline_s:g} s: {', '.join(absent)}")
                continue
            delay_s = self._pace.delay_s(self._core.tick)
            if delay_s <= 0.0:
                return True
            self._publish()
            if delay_s > Patience.SLICE_S:
                self._flush()  # held: who watches wants to see how it stands
            self._receive(min(delay_s, Patience.SLICE_S))
            patience = Patience(time.monotonic())

    def _send(self, begin: Begin) -> None:
        self._gather = Gather(begin.tick, begin.senses)
        # A paused process takes its step when it thaws, as one that was stopped at any moment does.
        senses = [
            (node, seal(Kind.DATA, self._attendance.token(node), sense.encode()))
            for node, sense in (*begin.unheard.items(), *begin.senses.items())
        ]
        for order in begin.signals:
            self._attendance.signalled(order.node, order.verb)
            self._put_signal(order.encode())
        self._put_positions(seal(Kind.DATA, 0, Opening(begin.positions.encode(), senses).encode()))
        for node in begin.senses:
            if not self._attendance.token(node):
                self._leave(node, 0, "died")

    def _collect(self, begin: Begin) -> float:
        """Wait for everybody who has not departed, then for the medium; returns when the last one had moved."""
        config, gather = self._config, self._gather
        late = {node for node, sense in begin.senses.items() if sense.first}
        patience = Patience(time.monotonic())
        sure: int | None = None
        while gather.missing:
            self._receive(Patience.SLICE_S)
            if gather.missing and not self._medium_answers():
                patience.excuse(time.monotonic())
                continue
            waited_s = patience.wait(time.monotonic())
            if waited_s > config.hang_deadline_s and gather.missing:
                # Who is silent is known when the medium has passed on what it holds.
                if sure is None:
                    sure = self._pongs + 1
                    self._ask()
                if self._pongs < sure:
                    continue
                sure = None
                excused = () if self._pace.interrupted or waited_s > config.return_deadline_s else late
                for node in sorted(gather.missing.difference(excused)):
                    self._leave(node, self._attendance.token(node), "unresponsive")
                    self._attendance.silent(node)
        moved_s = time.perf_counter()
        patience = Patience(time.monotonic())
        while self._complete < begin.tick:
            self._receive(Patience.SLICE_S)
            deadline_s = config.hang_deadline_s if self._pace.interrupted else config.medium_deadline_s
            if patience.wait(time.monotonic()) > deadline_s:
                raise _RunError(f"the medium was silent for {deadline_s:g} s")
        return moved_s

    def _medium_answers(self) -> bool:
        """Whether a node's silence is its own: nothing gets here past a medium that is stopped, for it is the router.

        Raises:
            _RunError: the medium has not answered for longer than its deadline.
        """
        now_s = time.monotonic()
        if self._asked is None:
            if now_s - self._heard_s > Patience.SLICE_S / 2:
                self._ask()
            return True
        deadline_s = self._config.hang_deadline_s if self._pace.interrupted else self._config.medium_deadline_s
        if self._asked.wait(now_s) > deadline_s:
            raise _RunError(f"the medium was silent for {deadline_s:g} s")
        return False

    def _ask(self) -> None:
        """Ping the medium, unless it owes an answer."""
        if self._asked is None:
            self._asked = Patience(time.monotonic())
            self._put_positions(seal(Kind.PING, 0))

    def _end(self) -> Stop | None:
        core, messages = self._core, self._gather.messages
        for node, (_, cause) in self._leaving.items():
            took = node in self._counted and node in messages
            log.info("tick %d: %s: %s", core.tick, _name(node), cause)
            core.depart(node, cause, counted=took)
            if not took:
                messages.pop(node, None)
        self._leaving.clear()
        if self._pace.interrupted:
            core.interrupt()
        motions: dict[int, Motion] = {n: m for n, m in messages.items() if isinstance(m, Motion)}
        report = messages.get(STATION)
        self._untold = True
        return core.end(motions, report if isinstance(report, Report) else None)

    def _publish(self) -> None:
        """Let everybody who watches know what the last tick came to."""
        if not self._untold:
            return
        self._untold = False
        told = self._core.tell()
        for event in told.events:
            self._put_event(event.encode())
        self._last = told.snapshot
        self._snapshots.append(told.snapshot)
        if len(self._snapshots) >= FEED_TICKS:
            self._flush()
        self._phases.mark("recording")

    def _leave(self, node: int, token: int, cause: str) -> None:
        """A node of this tick's roster is gone: nobody waits for it any longer."""
        self._gather.depart(node)
        self._leaving[node] = token, cause
        self._put_positions(seal(Kind.DEPARTED, 0, Departed(self._gather.tick, node).encode()))

    # What comes in

    def _receive(self, timeout_s: float) -> None:
        message = self._mailbox.get(timeout_s)
        if self._gather.tick != self._core.tick:
            self._phases.skip()
        self._phases.mark("waiting")
        if message is None:
            if not self._session.connected():
                raise LostError("router is gone")
            return
        self._heard_s = time.monotonic()
        try:
            self._take(message)
        except WireError as error:
            self._drop(f"message on {message[0]}", error)
        self._phases.mark("decode")
        if self._medium_lost:
            raise _RunError("the medium is gone")

    def _drop(self, what: str, error: WireError) -> None:
        self._dropped += 1
        if self._dropped == 1:
            log.warning("dropped a malformed %s: %s (further ones are only counted)", what, error)

    def _take(self, message: Message) -> None:
        key, data = message
        if key == self._moved_key and data is not None:
            moves = Moves.decode(data)
            for node, token, tick, motion in moves.answers:
                try:
                    self._answered(node, token, tick, motion)
                except WireError as error:
                    self._drop(f"answer of {_name(node)}", error)
            if moves.complete != NO_TICK:
                self._complete, self._counted = moves.complete, frozenset(moves.counted)
        elif key == self._pong_key and data is not None:
            self._asked = None
            self._pongs += 1
        elif key == _BY_HAND and data is not None:
            self._core.inject(parse_fault(data.decode()))
        elif "/alive/" in key:
            self._token_changed(key, present=data is not None)

    def _answered(self, node: int, token: int, tick: int, motion: bytes) -> None:
        left = node in self._leaving and self._leaving[node][0] == token
        seated = self._attendance.seated(node, token)
        if not left and not seated:
            if self._attendance.token(node):
                self._refuse(node, token)
            return
        message = Report.decode(motion) if node == STATION else self._motion(motion)
        if message.tick != tick:
            raise WireError(f"a motion of tick {message.tick} in an answer of tick {tick}")
        if left and tick == self._gather.tick:
            # It died, or was given up, a moment after it had answered: the medium may have heard this before it knew.
            self._gather.keep(node, message)
            if not seated and self._leaving[node][1] == "unresponsive" and self._attendance.token(node):
                self._refuse(node, token)  # another process took its place meanwhile
        if seated and (tick != self._gather.tick or not self._gather.add(node, message)):
            self._attendance.heard(node, token)

    def _motion(self, body: bytes) -> Motion:
        motion = Motion.decode(body)
        status = motion.status
        if max(status.nms, status.msr, status.nmsr) > self._config.robots:
            raise WireError("a status names a node that is not in this run")
        return motion

    def _token_changed(self, key: str, *, present: bool) -> None:
        token = self._session.keys.token_of(key)
        node, incarnation = token.node, token.incarnation
        if token.role == "medium":
            (self._mediums.add if present else self._mediums.discard)(key)
            self._medium_lost = not self._mediums
        elif node not in self._nodes:
            log.warning("there is no %s in this run", _name(node))
        elif present:
            if not self._attendance.came(node, incarnation):
                self._refuse(node, incarnation)
        elif self._attendance.left(node, incarnation):
            if self._core_ticks(node):
                self._leave(node, incarnation, "died")
            elif node not in self._leaving:
                self._core.depart(node, "died", counted=False)

    def _core_ticks(self, node: int) -> bool:
        """Whether `node` takes part in a tick that has begun and not ended."""
        begun = self._gather.tick == self._core.tick
        return begun and node in self._gather and node not in self._leaving

    def _refuse(self, node: int, token: int) -> None:
        self._put_words[node](seal(Kind.REFUSED, token))
        self._tell(node, f"a second living process of {_name(node)} was refused")

    def _tell(self, node: int, text: str) -> None:
        log.info("%s", text)
        self._put_event(Event(self._core.tick, "fault", node, text).encode())

    # The end

    def _flush(self) -> None:
        if self._snapshots:
            self._put_feed(batch([snapshot.encode() for snapshot in self._snapshots]))
            self._snapshots.clear()

    def _finish(self, stop: Stop) -> None:
        self._flush()
        self._put_phases(self._phases.encode())
        word = seal(Kind.STOP, 0, stop.encode())
        for put in self._put_words:
            put(word)
        self._put_positions(word)
        final: Mapping[str, Any] = (
            self._core.final()
            | self._stopwatch.final()
            | {"status": stop.reason, "stop_tick": stop.tick, "malformed": self._dropped}
        )
        self._put_final(msgpack.packb(final))
        log.info("stopped after tick %d: %s", stop.tick, stop.reason)
        self._await_answer()

    def _await_answer(self) -> None:
        """Stay until the medium has the stop: the end of the token may overtake what was put before it."""
        patience, owed = Patience(time.monotonic()), 1 if self._asked is None else 2
        while owed and patience.wait(time.monotonic()) <= self._config.hang_deadline_s:
            message = self._mailbox.get(Patience.SLICE_S)
            owed -= message == (self._pong_key, b"")
            if message is None and not self._session.connected():
                return


def _name(node: int) -> str:
    return f"robot {node}" if node != STATION else "station"
