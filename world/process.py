"""The world as a process: paces the ticks, moves bytes, and notices which processes come and go.

The core decides what follows from that: who takes part, which fault acts, when the run ends.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
from typing import Any

import msgpack

from bus.codec import WireError
from bus.envelopes import NO_TICK, Moves, Opening
from bus.lockstep import Gather, Kind, Patience, seal
from bus.malformed import Malformed
from bus.member import LostError, exit_status
from bus.nodes import node_name, user_name
from bus.phases import REPORT_TICKS, Phases
from bus.session import Login, Mailbox, Message, Session, new_token
from world.attendance import Attendance
from world.config import WorldConfig
from world.control import Control
from world.core import Begin, Core, World
from world.feed import Event
from world.limits import decode_word
from world.messages import Departed, Motion, Report, Stop
from world.pace import Pace
from world.silence import RunError, Silence
from world.stopwatch import Stopwatch
from world.terms import STATION, TICK_S
from world.watchers import Watchers

__all__ = ["run"]

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


class Shell:
    """Moves bytes between a world core and the bus."""

    def __init__(self, core: Core, config: WorldConfig, login: Login) -> None:
        self._core, self._config = core, config
        # What the shell keeps step with.
        self._session = Session.connect(login)
        self._mailbox = Mailbox()
        self._pace = Pace(config.speed, time.monotonic, held=config.held)
        self._control = Control(self._pace, config.robots, self._status)
        # Who is there.
        self._nodes = range(config.robots + 1)
        self._attendance = Attendance()
        self._leaving: dict[int, tuple[int, str]] = {}
        """(token, cause) of nodes that left during the tick, until the medium says whether they still counted."""
        self._mediums: set[str] = set()
        self._medium_lost = False
        # The tick under way.
        self._gather: Gather[Motion | Report] = Gather(-1, ())
        self._complete = NO_TICK
        """The last tick that the medium has said to be complete."""
        self._counted: frozenset[int] = frozenset()
        """Nodes whose transmission counted in it."""
        self._untold = False
        """The last tick is not yet published."""
        # What is measured.
        self._stopwatch = Stopwatch(time.time)
        self._phases = Phases(time.perf_counter)
        self._malformed = Malformed()
        self._open()

    def run(self) -> None:
        """All ticks, then the end."""
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda _number, _frame: self._pace.interrupt())
        with self._session:
            try:
                stop = self._ticks()
            except RunError as failure:
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
        self._watchers = Watchers(session)
        self._silence = Silence(self._config, time.monotonic, lambda: self._put_positions(seal(Kind.PING, 0)))
        self._pong_key, self._moved_key = keys.pong, keys.moved
        session.subscribe(self._mailbox, keys.moved, keys.pong)
        session.watch(self._mailbox, *(keys.alive(role) for role in ("medium", "station", "robot")))
        session.answer(keys.control, self._control.answer)
        session.declare(new_token("world"))

    def _status(self) -> dict[str, Any]:
        """How the run stands: the next tick, or the one under way, whom it waits for, and how far the search is."""
        last = self._watchers.last
        return {
            "tick": self._core.tick,
            "ticking": self._gather.tick == self._core.tick,
            "waiting_for": [node_name(node) for node in sorted(self._gather.missing)],
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
            for fault in self._control.take():
                core.inject(fault)
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
            last = None if self._gather.last is None else user_name(self._gather.last)
            self._stopwatch.tick(started_s, sent_s, moved_s, done_s, time.perf_counter(), last)
            if stop is not None:
                self._publish()
                return stop

    def _ready(self) -> bool:
        """Wait until the next tick may begin; False if the run was interrupted while a process was awaited."""
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
                    absent = [node_name(node) for node in sorted(awaited)] + ["medium"] * (not self._mediums)
                    raise RunError(f"not there within {self._config.return_deadline_s:g} s: {', '.join(absent)}")
                continue
            delay_s = self._pace.delay_s(self._core.tick)
            if delay_s <= 0.0:
                return True
            self._publish()
            if delay_s > Patience.SLICE_S:
                self._watchers.flush()  # held: watchers want to see the last tick
            self._receive(min(delay_s, Patience.SLICE_S))
            patience = Patience(time.monotonic())

    def _send(self, begin: Begin) -> None:
        self._gather = Gather(begin.tick, begin.senses)
        # A paused process takes its step when it thaws, as one that is stopped by hand does.
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
        """Wait for all nodes that have not departed, then for the medium; returns when the last node had answered."""
        gather, silence = self._gather, self._silence
        excused = {node for node, sense in begin.senses.items() if sense.first}
        silence.wait()
        while gather.missing:
            self._receive(Patience.SLICE_S)
            if gather.missing:
                for node in silence.given_up(gather.missing, excused, interrupted=self._pace.interrupted):
                    self._leave(node, self._attendance.token(node), "unresponsive")
                    self._attendance.silent(node)
        moved_s = time.perf_counter()
        silence.wait()
        while self._complete < begin.tick:
            self._receive(Patience.SLICE_S)
            silence.check_medium(interrupted=self._pace.interrupted)
        return moved_s

    def _end(self) -> Stop | None:
        core, messages = self._core, self._gather.messages
        for node, (_, cause) in self._leaving.items():
            took = node in self._counted and node in messages
            log.info("tick %d: %s: %s", core.tick, node_name(node), cause)
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
        """Tell the watchers the account of the last tick, unless that is done."""
        if not self._untold:
            return
        self._untold = False
        self._watchers.tell(self._core.tell())
        self._phases.mark("recording")

    def _leave(self, node: int, token: int, cause: str) -> None:
        """Wait no longer for a node of this tick's roster: it is gone."""
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
        self._silence.heard()
        try:
            self._take(message)
        except WireError as error:
            self._malformed.drop(f"message on {message[0]}", error)
        self._phases.mark("decode")
        if self._medium_lost:
            raise RunError("the medium is gone")

    def _take(self, message: Message) -> None:
        key, data = message
        if key == self._moved_key and data is not None:
            moves = Moves.decode(data)
            for node, token, tick, motion in moves.answers:
                try:
                    self._answered(node, token, tick, motion)
                except WireError as error:
                    self._malformed.drop(f"answer of {node_name(node)}", error)
            if moves.complete != NO_TICK:
                self._complete, self._counted = moves.complete, frozenset(moves.counted)
        elif key == self._pong_key and data is not None:
            self._silence.answered()
        elif self._session.keys.is_token(key):
            self._token_changed(key, present=data is not None)

    def _answered(self, node: int, token: int, tick: int, motion: bytes) -> None:
        left = node in self._leaving and self._leaving[node][0] == token
        seated = self._attendance.seated(node, token)
        if not left and not seated:
            if self._attendance.token(node):
                self._refuse(node, token)
            return
        message = decode_word(node, motion, self._config)
        if message.tick != tick:
            raise WireError(f"a motion of tick {message.tick} in an answer of tick {tick}")
        if left and tick == self._gather.tick:
            # It died or was given up just after it had answered: the medium may have counted this answer.
            self._gather.keep(node, message)
            if not seated and self._leaving[node][1] == "unresponsive" and self._attendance.token(node):
                self._refuse(node, token)  # another process has its seat by now
        if seated and (tick != self._gather.tick or not self._gather.add(node, message)):
            self._attendance.heard(node, token)

    def _token_changed(self, key: str, *, present: bool) -> None:
        token = self._session.keys.token_of(key)
        node, incarnation = token.node, token.incarnation
        if token.role == "medium":
            (self._mediums.add if present else self._mediums.discard)(key)
            self._medium_lost = not self._mediums
        elif node not in self._nodes:
            log.warning("there is no %s in this run", node_name(node))
        elif present:
            if not self._attendance.came(node, incarnation):
                self._refuse(node, incarnation)
        elif self._attendance.left(node, incarnation) and node not in self._leaving:
            if self._gather.tick == self._core.tick and node in self._gather:
                self._leave(node, incarnation, "died")
            else:
                self._core.depart(node, "died", counted=False)

    def _refuse(self, node: int, token: int) -> None:
        self._put_words[node](seal(Kind.REFUSED, token))
        self._tell(node, f"a second living process of {node_name(node)} was refused")

    def _tell(self, node: int, text: str) -> None:
        log.info("%s", text)
        self._watchers.event(Event(self._core.tick, "fault", node, text))

    # The end

    def _finish(self, stop: Stop) -> None:
        self._watchers.flush()
        self._put_phases(self._phases.encode())
        word = seal(Kind.STOP, 0, stop.encode())
        for put in self._put_words:
            put(word)
        self._put_positions(word)
        ended = {"status": stop.reason, "stop_tick": stop.tick, "malformed": self._malformed.count}
        self._put_final(msgpack.packb(self._core.final() | self._stopwatch.final() | ended))
        log.info("stopped after tick %d: %s", stop.tick, stop.reason)
        self._await_answer()

    def _await_answer(self) -> None:
        """Stay until the medium has the stop, since the end of a token may overtake what was put before it."""
        patience, owed = Patience(time.monotonic()), 1 + self._silence.owed
        while owed and patience.wait(time.monotonic()) <= self._config.hang_deadline_s:
            message = self._mailbox.get(Patience.SLICE_S)
            owed -= message == (self._pong_key, b"")
            if message is None and not self._session.connected():
                return
