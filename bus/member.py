"""A node's side of the lockstep, for robots and the station alike.

A turn begins when its message arrives: the sense of a tick and, except at the node's first tick, the inbox of the same
tick. Turns for another process of this node are ignored.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from typing import Final, Generic, Protocol, Self, TypeVar

from bus.codec import WireError
from bus.envelopes import Answer, Refused, Turn
from bus.excerpt import shown
from bus.heartbeat import Heartbeat
from bus.lockstep import Kind, seal, unseal
from bus.malformed import Malformed
from bus.phases import REPORT_TICKS, Phases
from bus.session import BusError, Login, Mailbox, Session, new_token

__all__ = [
    "END", "LATE_STOP_S", "LOST_STATUS", "REFUSED_STATUS", "LostError", "Member", "RefusedError", "Watch",
    "exit_status",
]  # fmt: skip

END: Final = ("", None)
"""A message that the handler of SIGTERM puts: end in good order."""

LOST_STATUS: Final = 3
"""Exit status of a process that lost the world, the medium or the router."""

REFUSED_STATUS: Final = 4
"""Exit status of a process whose node has a living process already."""

_POLL_S: Final = 0.5
LATE_STOP_S: Final = 2.0
"""The world's last message may arrive this much after the end of its token, which may overtake it."""

_NOBODY_S: Final = 60.0

log = logging.getLogger(__name__)


class LostError(BusError):
    """The world, the medium or the router is gone."""


class RefusedError(BusError):
    """Another living process is this node already, or the run speaks another version of the wire."""


@contextlib.contextmanager
def exit_status() -> Iterator[None]:
    """Turn a `BusError` into the last line of the process's log and an exit status.

    Raises:
        SystemExit: with REFUSED_STATUS, or with LOST_STATUS for any other trouble with the bus.
    """
    try:
        yield
    except BusError as error:
        log.error("%s: this process ends", error)  # a traceback would hide the one line that matters
        raise SystemExit(REFUSED_STATUS if isinstance(error, RefusedError) else LOST_STATUS) from None


class _Sense(Protocol):
    @property
    def tick(self) -> int: ...

    @property
    def first(self) -> bool: ...


class _Inbox(Protocol):
    @property
    def tick(self) -> int: ...


S = TypeVar("S", bound=_Sense)
I = TypeVar("I", bound=_Inbox)  # noqa: E741  # reads as "inbox" beside S for "sense"


class Watch:
    """Whether the processes that every process depends on are still there."""

    def __init__(self, session: Session, mailbox: Mailbox, *roles: str) -> None:
        """Watch the tokens of `roles`. They arrive in `mailbox`, and the caller hands them to `see`."""
        self._session = session
        self._tokens: dict[str, set[str]] = {role: set() for role in roles}
        self._seen: set[str] = set()
        self._since_s = time.monotonic()
        session.watch(mailbox, *(session.keys.alive(role) for role in roles))

    def see(self, key: str, data: bytes | None) -> str | None:
        """Note the coming or going of a token; returns the role that has just been lost.

        Raises:
            RefusedError: its process speaks another version of the wire.
        """
        token = self._session.keys.token_of(key)
        if token.mismatch:
            raise RefusedError(f"refused: {shown(token.mismatch)}")
        role = token.role
        held = self._tokens[role]
        if data is not None:
            held.add(key)
            self._seen.add(role)
        else:
            held.discard(key)
        return role if role in self._seen and not held else None

    def check(self) -> str | None:
        """What is missing, or None. The caller asks whenever nothing has arrived for a while."""
        if not self._session.connected():
            return "router"
        absent = [role for role in self._tokens if role not in self._seen]
        if absent and time.monotonic() - self._since_s > _NOBODY_S:
            return " and ".join(absent)
        return None


def _nothing() -> None:
    pass


class Member(Generic[S, I]):
    """One process of a node, as it takes part in the ticks."""

    def __init__(
        self, login: Login, role: str, node: int, sense: Callable[[bytes], S], inbox: Callable[[bytes], I]
    ) -> None:
        """Log in and join: the world admits this process at its next tick.

        Args:
            login: of this node.
            role: `robot` or `station`.
            node: its id.
            sense: decodes a sense, or raises `WireError`.
            inbox: decodes an inbox, or raises `WireError`.

        Raises:
            BusError: the router can't be reached or refuses.
        """
        self.session = Session.connect(login)
        self.mailbox = Mailbox()
        self.malformed = Malformed()
        self.phases = Phases(time.perf_counter)
        self.over = False
        """Whether the world has ended the run."""
        self.idle: Callable[[], None] = _nothing
        """Called whenever no message has come for a while."""
        self._joined = False
        """Whether the first turn has begun. Time before it belongs to no phase."""
        keys = self.session.keys
        self._decode_sense, self._decode_inbox = sense, inbox
        self._token = new_token(role, node)
        self._word_key, self._rx_key = keys.word(node), keys.rx(node, self._token.incarnation)
        self._put_tx = self.session.publisher(keys.tx(node), blocking=True)
        self._put_phases = self.session.publisher(keys.phases(login.user), blocking=False)
        self.session.subscribe(self.mailbox, self._word_key, self._rx_key)
        self._watch = Watch(self.session, self.mailbox, "world", "medium")
        self._turn: tuple[S, I | None] | None = None
        self._heartbeat = Heartbeat(self._token.incarnation, self.session.publisher(keys.beat(node), blocking=True))
        # The token comes last: a process that sees it may rely on the subscriptions.
        self.session.declare(self._token)

    def turn(self) -> tuple[S, I | None] | None:
        """Wait for the next tick; returns its sense and its inbox (None at a first tick), or None when the run is over.

        Raises:
            LostError: the world, the medium or the router is gone.
            RefusedError: another living process is this node, or the run speaks another version of the wire.
        """
        mark, heartbeat = self.phases.mark, self._heartbeat
        while True:
            heartbeat.switches += 1
            message = self.mailbox.get(_POLL_S)
            heartbeat.switches += 1
            if not self._joined:
                self.phases.skip()
            mark("waiting")
            if message is None:
                self.idle()
                if (what := self._watch.check()) is not None:
                    raise LostError(f"{what} is gone")
                continue
            if message == END or self._take(*message):
                self._put_phases(self.phases.encode())
                return None
            mark("decode")
            turn, self._turn = self._turn, None
            if turn is not None:
                self._joined = True
                if turn[0].tick % REPORT_TICKS == 0:
                    self._put_phases(self.phases.encode())
                return turn

    def _take(self, key: str, data: bytes | None) -> bool:
        """Take in one message; True if it ends the run."""
        try:
            if key == self._rx_key and data is not None:
                self._begin(Turn.decode(data))
                return False
            if key == self._word_key and data is not None:
                return self._told(data)
            return self._token_changed(key, data)
        except WireError as error:
            self.malformed.drop(f"message on {key}", error)
            return False

    def _begin(self, turn: Turn) -> None:
        _, token, body = unseal(turn.sense)
        if token != self._token.incarnation:
            return
        sense = self._decode_sense(body)
        if sense.first:
            self._turn = sense, None
            return
        if not turn.inbox:
            raise WireError("an inbox is missing")
        inbox = self._decode_inbox(turn.inbox)
        if inbox.tick != sense.tick:
            raise WireError(f"an inbox of tick {inbox.tick} in tick {sense.tick}")
        self._turn = sense, inbox

    def _told(self, data: bytes) -> bool:
        """Take a message of the world; True if it ends the run."""
        kind, token, body = unseal(data)
        if kind == Kind.REFUSED and token == self._token.incarnation:
            raise RefusedError(f"refused: {shown(Refused.decode(body).why, 200)}")
        self.over = kind == Kind.STOP
        if self.over:
            log.info("the world says that the run is over: this process ends")
        return self.over

    def _token_changed(self, key: str, data: bytes | None) -> bool:
        lost = self._watch.see(key, data)
        if lost is None:
            return False
        until_s = time.monotonic() + LATE_STOP_S
        while (left_s := until_s - time.monotonic()) > 0.0 and self.session.connected():
            message = self.mailbox.get(min(left_s, _POLL_S))
            if message is None:
                continue
            with contextlib.suppress(WireError):
                if message == END or (message[0] == self._word_key and message[1] and self._told(message[1])):
                    return True
        raise LostError(f"{lost} is gone")

    def answer(self, tick: int, transmission: bytes, motion: bytes) -> None:
        """Send the answer that ends the turn."""
        self._put_tx(seal(Kind.DATA, self._token.incarnation, Answer(tick, transmission, motion).encode()))
        self.phases.mark("encode")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the run: the token of this process drops."""
        self._heartbeat.stop()
        self.session.close()
