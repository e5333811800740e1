"""The radio as a process: it hosts the router or joins one, gathers the answers of a tick, and hands out turns.

It passes on unread each sense from the world to its node, together with the inbox. A motion goes on to the world if
the whole answer is possible (`medium/answers.py`).

It has no deadline for nodes: it leaves a node out of a tick only when the world says so.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from typing import Any, Final, Protocol

import msgpack

from bus.breaker import Breaker
from bus.codec import WireError
from bus.envelopes import NO_TICK, Answer, Flood, Moves, Opening, Turn
from bus.excerpt import shown
from bus.lockstep import Gather, Kind, unseal
from bus.malformed import Malformed
from bus.member import LATE_STOP_S, LostError, RefusedError, exit_status
from bus.nodes import node_name
from bus.phases import REPORT_TICKS, Phases
from bus.session import Login, Mailbox, Put, Session, new_token
from medium.answers import transmission_of
from medium.config import MediumConfig
from medium.core import Medium
from medium.messages import Inbox, Transmission
from world.feed import Event
from world.messages import Departed, Positions

__all__ = ["run"]

_POLL_S: Final = 0.5
_LINGER_S: Final = 10.0
_LINGER_ROBOTS_S: Final = 1.0
"""How long to wait for robots where no launcher tells who is left."""
_QUIET_S: Final = 0.25
"""Time for the last messages to leave the router's queues where there is no launcher."""
_START_S: Final = 60.0
_MOST_STRAY: Final = 100
"""Messages of a node that no tick waits for: that many, and one more in each tick. Honest processes have one now and
then: when a process thaws, or its successor has its seat."""

log = logging.getLogger(__name__)


def run(config: MediumConfig, login: Login, users: Mapping[str, str] | None) -> None:
    """Run the medium until the run ends.

    Args:
        config: of the radio.
        login: where the router is, and this process's user.
        users: passwords by user, to host the router at `login.endpoint`. None: join the router that is there.

    Raises:
        SystemExit: the port is in use, the router can't be reached, or the world was lost (status 3).
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    with exit_status():
        session = Session.connect(login) if users is None else Session.host(login, users)
        with session:
            Shell(Medium(config), config, session, hosts=users is not None).run()


class Core(Protocol):
    """What the shell drives: `medium.core.Medium`, or a core that does nothing, to measure the shell alone."""

    def step(self, positions: Positions, transmissions: Mapping[int, Transmission]) -> dict[int, Inbox]: ...
    def final(self) -> dict[str, Any]: ...


class Shell:
    """Moves bytes in and out of a medium core."""

    def __init__(self, core: Core, config: MediumConfig, session: Session, *, hosts: bool) -> None:
        self._core, self._config, self._session, self._hosts = core, config, session, hosts
        self._mailbox = Mailbox()
        self._positions: Positions | None = None
        self._gather: Gather[Transmission] = Gather(-1, ())
        self._inboxes: dict[int, bytes] = {}
        """By node, for the next tick."""
        self._moves: list[tuple[int, int, int, bytes]] = []
        """Answers that count, and the world has not been told."""
        self._strays: list[tuple[int, int]] = []
        """(node, token) of processes that no tick waits for, and the world has not been told."""
        self._alive: dict[str, set[str]] = {role: set() for role in ("world", "station", "robot", "operator")}
        self._world_seen = False
        self._stopped = False
        self._malformed = Malformed()
        self._stray: dict[int, int] = {}
        """By node: its messages that no tick waited for."""
        self._floods: dict[str, int] = {}
        """By key: nodes that are not heard any more, because they put too much."""
        self._seats: dict[int, tuple[int, Put]] = {}
        """By node: the process that takes part, by its token, and the way to it."""
        self._breaker = Breaker(session.login.endpoint, self._link_cut)
        keys = session.keys
        self._positions_key = keys.positions
        self._nodes: dict[str, int] = {}
        self._put_pong = session.publisher(keys.pong, blocking=True)
        self._put_moved = session.publisher(keys.moved, blocking=True)
        self._put_flood = session.publisher(keys.flood, blocking=True)
        self._put_final = session.publisher(keys.final("medium"), blocking=True)
        self._put_event = session.publisher(keys.event, blocking=False)
        self._phases = Phases(time.perf_counter)
        self._put_phases = session.publisher(keys.phases("medium"), blocking=False)
        session.subscribe(self._mailbox, keys.positions)
        session.subscribe(self._mailbox, keys.tx("*"), bounded=True)
        session.watch(self._mailbox, *(keys.alive(role) for role in self._alive))
        session.declare(new_token("medium"))

    def run(self) -> None:
        """All ticks, then the end."""
        with self._breaker:
            self._run()

    def _run(self) -> None:
        since_s = time.monotonic()
        while not self._stopped:
            self._receive(_POLL_S)
            if not self._world_seen and time.monotonic() - since_s > _START_S:
                raise LostError(f"no world came within {_START_S:g} s")
            if self._world_seen and not self._alive["world"] and not self._last_words():
                raise LostError("world is gone")
        self._put_phases(self._phases.encode())
        malformed = self._malformed.count + sum(self._mailbox.excess.values())
        self._put_final(msgpack.packb(self._core.final() | {"malformed": malformed}))
        self._linger()

    def _receive(self, timeout_s: float) -> bool:
        message = self._mailbox.get(timeout_s)
        if self._gather.tick < 0:
            self._phases.skip()
        self._phases.mark("waiting")
        if message is None:
            if not self._hosts and not self._session.connected():
                raise LostError("router is gone")
            return False
        key, data = message
        try:
            if self._session.keys.is_token(key):
                self._token_changed(key, present=data is not None)
            elif key == self._positions_key:
                self._world_says(data or b"")
            else:
                self._transmitted(key, data or b"")
        except WireError as error:
            self._malformed.drop(f"message on {key}", error)
            if key in self._nodes:
                self._strayed(key)
        for flooded in self._mailbox.floods():
            self._flooded(flooded)
        self._phases.mark("decode")
        return True

    def _strayed(self, key: str) -> None:
        """Count a message that no tick waited for; too many of them are a flood."""
        node = self._nodes[key]
        count = self._stray[node] = self._stray.get(node, 0) + 1
        if count > _MOST_STRAY + self._gather.tick:
            self._mailbox.mute(key)

    def _flooded(self, key: str) -> None:
        """Name to the world a node that the mailbox does not hear any more."""
        node = self._floods[key] = self._session.keys.node_of(key)
        log.warning("%s floods the medium: it is not heard any more", node_name(node))
        self._put_flood(Flood(node).encode())

    def _link_cut(self, node: int) -> None:
        """A link is cut: a process that takes nothing stood in the way of the turns of `node`."""
        words = f"a process that listens for {node_name(node)} took nothing: its link was cut"
        log.warning("%s", words)
        tick = max(self._gather.tick, 0)
        self._put_event(Event(tick, "fault", node, words).encode())

    def _token_changed(self, key: str, *, present: bool) -> None:
        token = self._session.keys.token_of(key)
        role = token.role
        if role == "world" and token.mismatch:
            raise RefusedError(f"refused: {shown(token.mismatch)}")
        (self._alive[role].add if present else self._alive[role].discard)(key)
        self._world_seen = self._world_seen or (role == "world" and present)

    def _world_says(self, data: bytes) -> None:
        kind, _, body = unseal(data)
        if kind == Kind.STOP:
            self._stopped = True
            self._put_pong(b"")
        elif kind == Kind.DEPARTED:
            departed = Departed.decode(body)
            if departed.tick == self._gather.tick:
                self._gather.depart(departed.node)
                self._step_if_complete()
        elif kind == Kind.PING:
            self._pass_on()
            self._put_pong(b"")
        else:
            self._begin(Opening.decode(body))

    def _begin(self, opening: Opening) -> None:
        positions = Positions.decode(opening.positions)
        turns = [(node, self._way_to(node, unseal(sense)[1]), sense) for node, sense in opening.senses]
        self._positions = positions
        self._gather = Gather(positions.tick, positions.nodes.tolist())
        self._phases.mark("decode")
        inboxes, self._inboxes = self._inboxes, {}
        breaker = self._breaker
        for node, put, sense in turns:
            breaker.node = node
            breaker.puts += 1
            put(Turn(sense, inboxes.get(node, b"")).encode())
            breaker.puts += 1
        for key, node in list(self._floods.items()):
            if node in self._gather:
                del self._floods[key]
                self._malformed.count += self._mailbox.pardon(key)
                self._stray.pop(node, None)
        self._phases.mark("encode")
        self._step_if_complete()

    def _way_to(self, node: int, token: int) -> Put:
        """Puts turns to the process of that token, and to no other process of `node`."""
        known = self._seats.get(node)
        if known is not None and known[0] == token:
            return known[1]
        put = self._session.publisher(self._session.keys.rx(node, token), blocking=True)
        self._seats[node] = token, put
        return put

    def _transmitted(self, key: str, data: bytes) -> None:
        node = self._nodes.get(key)
        if node is None:
            node = self._nodes[key] = self._session.keys.node_of(key)
        _, token, body = unseal(data)
        answer = Answer.decode(body)
        transmission = transmission_of(node, answer, self._config)
        seat, _ = self._seats.get(node, (0, None))
        # Token 0 stands for no process: the world knew of none when the tick began.
        if not token or token != seat or answer.tick != self._gather.tick or node not in self._gather.missing:
            # From a process that was too late or was given up, or has no seat: the world must learn of it.
            self._strayed(key)
            self._strays.append((node, token))
            self._pass_on()
            return
        self._moves.append((node, token, answer.tick, answer.motion))
        self._gather.add(node, transmission)
        self._step_if_complete()

    def _pass_on(self, complete: int = NO_TICK) -> None:
        """Pass the motions on to the world, in the order of arrival, so that the world learns who was last."""
        if self._moves or self._strays or complete != NO_TICK:
            self._put_moved(Moves(self._moves, complete, self._strays).encode())
            self._moves, self._strays = [], []

    def _step_if_complete(self) -> None:
        positions = self._positions
        if self._gather.missing or positions is None:
            return
        self._positions = None
        transmissions = self._gather.messages
        # Before the step, so that the world can go on meanwhile.
        self._pass_on(positions.tick)
        self._phases.mark("decode")
        inboxes = self._core.step(positions, transmissions)
        self._phases.mark("step")
        self._inboxes = {node: inbox.encode() for node, inbox in inboxes.items()}
        self._phases.mark("encode")
        if positions.tick % REPORT_TICKS == 0:
            self._put_phases(self._phases.encode())

    # The end

    def _last_words(self) -> bool:
        """Wait for messages that the end of the world's token has overtaken; True if `Stop` was among them."""
        until_s = time.monotonic() + LATE_STOP_S
        while not self._stopped and (left_s := until_s - time.monotonic()) > 0.0:
            self._receive(left_s)
        return self._stopped

    def _linger(self) -> None:
        """Stay until the other processes have sent their last messages, ten seconds at most: the router is here.

        A launcher drops its token when it has received everything. Without a launcher this process leaves when nothing
        has come for a moment. It does not wait long for robots, since one may be stopped and never end.
        """
        since_s = time.monotonic()
        launched = bool(self._alive["operator"])
        while (passed_s := time.monotonic() - since_s) < _LINGER_S:
            quiet = not self._receive(_QUIET_S)
            alive = {role for role, tokens in self._alive.items() if tokens}
            if launched and "operator" not in alive:
                return
            if not launched and quiet and (not alive or (alive == {"robot"} and passed_s > _LINGER_ROBOTS_S)):
                return
