"""Keeping step: for whom each side of a tick waits, without clocks and without sockets.

A tick is a barrier: each node of its roster sends exactly one message, or departs. That is a synchronous dataflow
network, so the order in which messages arrive cannot matter (Lee & Messerschmitt 1987).

Messages of the world and answers of nodes carry a header: the kind of the message, and the process that it is for or
from. The header is needed because the old and the new process of a restarted robot share its keys. To *seal* a message
is to put the header before it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Final, Generic, TypeVar

import msgpack

from bus.codec import WireError, unpacked

__all__ = ["Gather", "Kind", "Patience", "batch", "seal", "unbatch", "unseal"]

T = TypeVar("T")

_HEADER: Final = struct.Struct("<BI")


class Kind(IntEnum):
    """Kind of the message behind a header."""

    DATA = 0
    """The message that belongs to the key."""
    DEPARTED = 1
    """`Departed`, to the medium."""
    STOP = 2
    """`Stop`, to everybody. The medium answers as it does to a ping."""
    REFUSED = 3
    """`Refused`, to the one process that the header names."""
    PING = 4
    """Empty, to the medium, which passes on what has come in and then answers on its `pong` key."""


_KINDS: Final = frozenset(map(int, Kind))


def seal(kind: Kind, token: int, body: bytes = b"") -> bytes:
    """Put a header before a message. `token` is the incarnation of a process's liveliness token, 0 for no process."""
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
    """Pack several messages as one, for feeds outside the lockstep."""
    return msgpack.packb(messages)  # type: ignore[no-any-return]


def unbatch(data: bytes) -> list[bytes]:
    """Unpack a batch.

    Raises:
        WireError: it is not a batch.
    """
    messages = unpacked(data)
    if not isinstance(messages, list) or not all(isinstance(m, bytes) for m in messages):
        raise WireError("a batch is a list of messages")
    return messages


class Gather(Generic[T]):
    """The barrier of one tick: it collects one message from each node that has not departed."""

    __slots__ = ("_messages", "_nodes", "last", "missing", "tick")

    def __init__(self, tick: int, nodes: Iterable[int]) -> None:
        self.tick = tick
        self._nodes = frozenset(nodes)
        self.missing = set(self._nodes)
        """Nodes that it waits for."""
        self._messages: dict[int, T] = {}
        self.last: int | None = None
        """Node whose message came last."""

    def __contains__(self, node: int) -> bool:
        """Whether `node` is in the roster of this tick."""
        return node in self._nodes

    def add(self, node: int, message: T) -> bool:
        """Take a node's message; False if the tick does not wait for that node (any more)."""
        if node not in self.missing:
            return False
        self.missing.remove(node)
        self._messages[node] = message
        self.last = node
        return True

    def depart(self, node: int) -> None:
        """Wait for `node` no longer. A message that it has sent already stays."""
        self.missing.discard(node)

    def keep(self, node: int, message: T) -> None:
        """Take the message of a node that has departed, in case the medium has counted it."""
        self._messages.setdefault(node, message)

    @property
    def messages(self) -> dict[int, T]:
        """By node, ascending, in whatever order they arrived."""
        return dict(sorted(self._messages.items()))


class Patience:
    """How long a tick has waited for a silent node. A suspended host costs no node its seat.

    Wall time is counted in slices. A slice that took much longer than planned counts as one slice: the host was
    suspended, or the waiting process itself got no processor.
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
        """Leave the time since the last call out."""
        self._since_s = now_s
