"""The world as a process: paces the ticks, moves bytes, and notices which processes come and go.

The core decides what follows from that: who takes part, which fault acts, when the run ends.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
from typing import Any, Final

from bus.codec import WireError
from bus.envelopes import Flood, Moves, Opening
from bus.excerpt import shown
from bus.heartbeat import Beat
from bus.lockstep import Kind, Patience, seal
from bus.malformed import Malformed
from bus.member import LostError, exit_status
from bus.nodes import node_name, user_name
from bus.phases import REPORT_TICKS, Phases
from bus.session import Login, Mailbox, Message, Session, new_token
from world.attendance import Attendance
from world.config import WorldConfig
from world.control import Control
from world.core import DIED, Begin, Core, World
from world.feed import Absence, Event, Signal
from world.messages import Motion, Report, Stop
from world.outlets import Outlets
from world.pace import Pace
from world.silence import RunError, Silence
from world.stopwatch import Stopwatch
from world.terms import STATION, TICK_S
from world.turnout import Turnout
from world.watchers import Watchers

__all__ = ["run"]

_LOOK_S: Final = 0.5
"""Wall time after which, again and again, the launcher is asked for a process that a tick waits for."""

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
        self._control = Control(self._pace, config.robots, self._status, config.external)
        # Who is there.
        self._nodes = range(config.robots + 1)
        self._attendance = Attendance()
        self._medium_tokens: set[str] = set()
        self._medium_lost = False
        # The tick under way.
        self._turnout = Turnout(self._attendance, config)
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
        self._outlets = Outlets(session, self._nodes)
        self._put_phases = session.publisher(keys.phases("world"), blocking=False)
        self._watchers = Watchers(session)
        self._silence = Silence(self._config, time.monotonic, self._outlets.ping)
        self._pong_key, self._moved_key = keys.pong, keys.moved
        session.subscribe(self._mailbox, keys.moved, keys.pong, keys.flood, keys.absence)
        session.subscribe(self._mailbox, keys.beat("*"), bounded=True)
        session.watch(self._mailbox, *(keys.alive(role) for role in ("medium", "station", "robot")))
        session.answer(keys.control, self._control.answer)
        session.declare(new_token("world"))

    def _status(self) -> dict[str, Any]:
        """How the run stands: the next tick, or the one under way, whom it waits for, and how far the search is."""
        last = self._watchers.last
        return {
            "tick": self._core.tick,
            "ticking": self._turnout.tick == self._core.tick,
            "waiting_for": [node_name(node) for node in sorted(self._turnout.missing)],
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
            moved_s = self._collect()
            done_s = time.perf_counter()
            stop = self._end()
            self._phases.mark("step")
            if begin.tick % REPORT_TICKS == 0:
                self._put_phases(self._phases.encode())
            last = None if self._turnout.last is None else user_name(self._turnout.last)
            self._stopwatch.tick(started_s, sent_s, moved_s, done_s, time.perf_counter(), last)
            if stop is not None:
                self._publish()
                return stop

    def _ready(self) -> bool:
        """Wait until the next tick may begin; False if the run was interrupted while a process was awaited."""
        patience, asked_s = Patience(time.monotonic()), 0.0
        while True:
            for node, new in self._attendance.arrivals():
                self._core.arrive(node, new=new)
            awaited = self._core.awaited()
            if awaited or not self._medium_tokens:
                self._publish()
                if self._pace.interrupted:
                    return False
                self._receive(Patience.SLICE_S)
                waited_s = patience.wait(time.monotonic())
                if waited_s - asked_s > _LOOK_S:
                    asked_s = waited_s
                    for node in awaited:
                        self._outlets.signal(Signal(self._core.tick, node, "look"))
                if waited_s > self._config.return_deadline_s:
                    absent = [node_name(node) for node in sorted(awaited)] + ["medium"] * (not self._medium_tokens)
                    who = shown(", ".join(absent), 300)
                    raise RunError(f"not there within {self._config.return_deadline_s:g} s: {who}")
                continue
            delay_s = self._pace.delay_s(self._core.tick)
            if delay_s <= 0.0:
                return True
            self._publish()
            if delay_s > Patience.SLICE_S:
                self._watchers.flush()  # held: watchers want to see the last tick
            self._receive(min(delay_s, Patience.SLICE_S))
            patience, asked_s = Patience(time.monotonic()), 0.0

    def _send(self, begin: Begin) -> None:
        self._turnout.begin(begin.tick, list(begin.senses))
        # A paused process takes its step when it thaws, as one that is stopped by hand does.
        senses = [
            (node, seal(Kind.DATA, self._attendance.token(node), sense.encode()))
            for node, sense in (*begin.unheard.items(), *begin.senses.items())
        ]
        for order in begin.signals:
            self._attendance.signalled(order.node, order.verb)
            self._outlets.signal(order)
        self._outlets.open(Opening(begin.positions.encode(), senses))
        for node in begin.senses:
            if not self._attendance.token(node):
                self._leave(node, DIED)

    def _collect(self) -> float:
        """Wait for all nodes that have not departed, then for the medium; returns when the last node had answered."""
        turnout, silence = self._turnout, self._silence
        silence.wait()
        while turnout.missing:
            self._receive(Patience.SLICE_S)
            if turnout.missing:
                for node, cause in silence.given_up(turnout.missing, interrupted=self._pace.interrupted):
                    self._leave(node, cause)
                    self._attendance.silent(node)
        moved_s = time.perf_counter()
        silence.wait()
        while not turnout.complete:
            self._receive(Patience.SLICE_S)
            silence.check_medium(interrupted=self._pace.interrupted)
        return moved_s

    def _end(self) -> Stop | None:
        core = self._core
        left, messages = self._turnout.close()
        for node, cause, counted in left:
            log.info("tick %d: %s: %s", core.tick, node_name(node), cause)
            core.depart(node, cause, counted=counted)
        if self._pace.interrupted:
            core.interrupt()
        motions: dict[int, Motion] = {n: m for n, m in messages.items() if isinstance(m, Motion)}
        report = messages.get(STATION)
        self._untold = True
        return core.end(motions, report if isinstance(report, Report) else None)

    def _publish(self) -> None:
        """Tell the watchers the account of the last tick, unless that is done."""
        if self._untold:
            self._untold = False
            self._watchers.tell(self._core.tell())
            self._phases.mark("recording")

    def _leave(self, node: int, cause: str, token: int | None = None) -> None:
        """A node leaves, in the tick under way or before the next. `token`: of its process, if that has no seat."""
        if self._turnout.tick != self._core.tick or node not in self._turnout:
            self._core.depart(node, cause, counted=False)
        elif self._turnout.leave(node, self._attendance.token(node) if token is None else token, cause):
            self._outlets.departed(self._core.tick, node)

    # What comes in

    def _receive(self, timeout_s: float) -> None:
        message = self._mailbox.get(timeout_s)
        if self._turnout.tick != self._core.tick:
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
        for key in self._mailbox.floods():
            self._flooded(self._session.keys.node_of(key))
        self._phases.mark("decode")
        if self._medium_lost:
            raise RunError("the medium is gone")

    def _take(self, message: Message) -> None:
        key, data = message
        keys = self._session.keys
        if key == self._moved_key and data is not None:
            moves = Moves.decode(data)
            for node, token, tick, motion in moves.answers:
                try:
                    if not self._turnout.answer(node, token, tick, motion):
                        self._refuse(node, token)
                except WireError as error:
                    self._malformed.drop(f"answer of {node_name(node)}", error)
            for node, token in moves.strays:
                if not self._turnout.stray(node, token):
                    self._refuse(node, token)
            self._turnout.completed(moves.complete)
        elif key == self._pong_key:
            self._silence.answered()
        elif keys.is_token(key):
            self._token_changed(key, present=data is not None)
        elif key == keys.flood:
            self._flooded(Flood.decode(data or b"").node)
        elif key == keys.absence:
            self._absent(Absence.decode(data or b""))
        else:
            beat, node = Beat.decode(data or b""), keys.node_of(key)
            if not self._silence.beat(node, beat.spent_s, counts=self._attendance.seated(node, beat.token)):
                self._mailbox.mute(key)

    def _token_changed(self, key: str, *, present: bool) -> None:
        token = self._session.keys.token_of(key)
        node, incarnation = token.node, token.incarnation
        if token.role == "medium":
            if token.mismatch:
                raise RunError(token.mismatch)
            (self._medium_tokens.add if present else self._medium_tokens.discard)(key)
            self._medium_lost = not self._medium_tokens
        elif node not in self._nodes:
            log.warning("there is no %s in this run", node_name(node))
        elif present:
            if token.mismatch or not self._attendance.came(node, incarnation):
                self._refuse(node, incarnation, token.mismatch)
            elif (beats := self._session.keys.beat(node)) in self._mailbox.excess:
                self._malformed.count += self._mailbox.pardon(beats)
                self._silence.pardon(node)
        elif self._attendance.left(node, incarnation):
            self._leave(node, DIED, incarnation)

    def _absent(self, absence: Absence) -> None:
        """The process of a node that the next tick waits for is dead or stopped: the tick begins without it."""
        node = absence.node
        if node in self._core.awaited() and not self._attendance.token(node):
            self._leave(node, DIED if absence.dead else "unresponsive")

    def _flooded(self, node: int) -> None:
        """A node puts more than can be taken in: it is left out, until a new process of it comes."""
        if node in self._nodes and self._attendance.token(node):
            self._leave(node, "floods the run with messages")
            self._attendance.shut_out(node)

    def _refuse(self, node: int, token: int, mismatch: str = "") -> None:
        if why := self._attendance.refuse(node, token, mismatch):
            self._outlets.refuse(node, token, why)
            self._tell(node, f"a process of {node_name(node)} was refused: {why}")

    def _tell(self, node: int, text: str) -> None:
        log.info("%s", text)
        self._watchers.event(Event(self._core.tick, "fault", node, text))

    # The end

    def _finish(self, stop: Stop) -> None:
        self._watchers.flush()
        self._put_phases(self._phases.encode())
        malformed = self._malformed.count + sum(self._mailbox.excess.values())
        ended = {"status": stop.reason, "stop_tick": stop.tick, "malformed": malformed}
        self._outlets.stop(stop, self._core.final() | self._stopwatch.final() | ended)
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
