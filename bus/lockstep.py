"""Keeping step: what each side of a tick waits for, without clocks and without sockets.

A tick is a barrier: everybody in its roster sends exactly one message, or departs. That is a synchronous dataflow
network, so the order in which messages arrive cannot matter (Lee & Messerschmitt 1987).

What the world says and what a node answers carries a header: what kind of message it is, and to or from which process
of a node, since the old and the new process of a restarted robot share its keys.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Final, Generic, TypeVar

import msgpack

from bus.codec import WireError

__all__ = ["Gather", "Kind", "Patience", "batch", "seal", "unbatch", "unseal"]

T = TypeVar("T")

_HEADER: Final = struct.Struct("<BI")


class Kind(IntEnum):
    """What follows a header."""

    DATA = 0
    """The message that the key stands for."""
    DEPARTED = 1
    """`Departed`, to the medium."""
    STOP = 2
    """`Stop`, to everybody; the medium answers as to a ping."""
    REFUSED = 3
    """Nothing: another living process is this node."""
    PING = 4
    """Nothing, to the medium, which passes on what has come in and answers with nothing on its `pong` key."""


_KINDS: Final = frozenset(map(int, Kind))


def seal(kind: Kind, token: int, body: bytes = b"") -> bytes:
    """Put a header before a message; `token` is the incarnation of a process's liveliness token, 0 for nobody's."""
    return _HEADER.pack(kind, token) + body


def unseal(data: bytes) -> tuple[int, int, bytes]:
    """(kind, token, message) of a message with a header.

    Raises:
        WireError: there is no header, or it is of no known kind.
    """
    if len(data) < _HEADER.size:
        raise WireError("shorter than a header")
    kind, token = _HEADER.unpack_from(data)
    if kind not in _KINDS:
        raise WireError(f"unknown kind {kind}")
    return kind, token, data[_HEADER.size :]


def batch(messages: Sequence[bytes]) -> bytes:
    """Several messages as one, for feeds outside the lockstep."""
    return msgpack.packb(messages)  # type: ignore[no-any-return]


def unbatch(data: bytes) -> list[bytes]:
    """The messages of a batch.

    Raises:
        WireError: it is not a batch.
    """
    try:
        messages = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise WireError("not a batch") from error
    if not isinstance(messages, list) or not all(isinstance(m, bytes) for m in messages):
        raise WireError("a batch is a list of messages")
    return messages


class Gather(Generic[T]):
    """The barrier of one tick: one message of each node that has not departed."""

    __slots__ = ("_messages", "_nodes", "last", "missing", "tick")

    def __init__(self, tick: int, nodes: Iterable[int]) -> None:
        self.tick = tick
        self._nodes = frozenset(nodes)
        self.missing = set(self._nodes)
        """Whom it waits for."""
        self._messages: dict[int, T] = {}
        self.last: int | None = None
        """Who was waited for last."""

    def __contains__(self, node: int) -> bool:
        """Whether `node` is in the roster of this tick."""
        return node in self._nodes

    def add(self, node: int, message: T) -> bool:
        """Take a node's message; False if none is wanted of it (any more)."""
        if node not in self.missing:
            return False
        self.missing.remove(node)
        self._messages[node] = message
        self.last = node
        return True

    def depart(self, node: int) -> None:
        """Wait for `node` no longer; a message that it already sent stays."""
        self.missing.discard(node)

    def keep(self, node: int, message: T) -> None:
        """Take the message of a node that has departed, if others may have counted it."""
        self._messages.setdefault(node, message)

    @property
    def messages(self) -> dict[int, T]:
        """By node, ascending, whatever the order of arrival."""
        return dict(sorted(self._messages.items()))


class Patience:
    """How long a tick has waited for a silent node, counted so that nobody pays for a suspended host.

    Wall time is counted in slices; a slice that took much longer than planned (the host was suspended, or the waiting
    process itself got no processor) counts as one slice.
    """

    SLICE_S: Final = 0.1

    __slots__ = ("_since_s", "waited_s")

    def __init__(self, now_s: float) -> None:
        self._since_s = now_s
        self.waited_s = 0.0

    def wait(self, now_s: float) -> float:
        """Count the time since the last call; returns the seconds waited so far."""
        self.waited_s += min(max(now_s - self._since_s, 0.0), self.SLICE_S)
        self._since_s = now_s
        return self.waited_s

    def excuse(self, now_s: float) -> None:
        """Let the time since the last call not count."""
        self._since_s = now_s
