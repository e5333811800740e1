"""Messages of any length: a message that is longer than a link can take travels in parts.

Zenoh's low-latency links lose messages of more than about 48 kB, since they do not fragment. The attachment of a part
tells to which message it belongs, and which part it is. If a part is dropped on the way, the message is dropped.
"""

from __future__ import annotations

import queue
import random
import struct
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final

__all__ = ["MOST_WAITING", "PART_BYTES", "Mailbox", "Message", "Put", "in_parts"]

Put = Callable[[bytes], None]
Message = tuple[str, bytes | None]
"""(key, payload). A payload of None means that the token of that key is gone."""

PART_BYTES: Final = 32_000
"""Two of them fit a batch of an ordinary link."""
_MOST_PARTS: Final = 4096
_SENDERS: Final = 2
"""The old and the new process of a node share its keys."""
MOST_WAITING: Final = _MOST_PARTS
"""Samples of one key. In lockstep a node has one message under way."""
_MARK: Final = struct.Struct("<III")
"""Message (a random number), part, parts."""


def in_parts(put: Callable[..., None]) -> Put:
    """A function that puts messages of any length by Zenoh's `put`."""

    def send(data: bytes) -> None:
        if len(data) <= PART_BYTES:
            put(data)
            return
        message, parts = random.getrandbits(32), -(-len(data) // PART_BYTES)
        if parts > _MOST_PARTS:
            raise ValueError(f"a message of {len(data)} bytes, where {_MOST_PARTS * PART_BYTES} are the most")
        for part in range(parts):
            start = part * PART_BYTES
            put(data[start : start + PART_BYTES], attachment=_MARK.pack(message, part, parts))

    return send


class Mailbox:
    """A queue of messages that any number of subscriptions fill and one thread empties."""

    def __init__(self, wake: Callable[[], None] | None = None) -> None:
        """`wake` is called whenever something was put, by the thread that put it."""
        self._samples: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._begun: dict[str, dict[int, list[bytes]]] = {}
        """By key and message: the parts that have arrived."""
        put = self._samples.put

        def put_and_wake(sample: Any) -> None:
            put(sample)
            if wake is not None:
                wake()

        self.put: Callable[[Any], None] = put if wake is None else put_and_wake
        """Puts a `Message` of this process, or a sample of Zenoh's."""
        self._waiting: dict[str, deque[Any]] = {}
        """By key: samples that `put_bounded` took and nobody has taken out."""
        self.excess: dict[str, int] = {}
        """By muted key: how many samples were dropped."""
        self._told: set[str] = set()
        """Muted keys that `floods` has told."""

    def put_bounded(self, sample: Any) -> None:
        """Put a sample of Zenoh's from a sender that may flood this mailbox.

        When too many samples of a key wait, it is muted.
        """
        key = str(sample.key_expr)
        if key in self.excess:
            self.excess[key] += 1
            return
        waiting = self._waiting.setdefault(key, deque())
        if len(waiting) == MOST_WAITING:
            self.excess[key] = 1
            return
        waiting.append(sample)
        self.put(waiting)

    def mute(self, key: str) -> None:
        """Drop what comes on `key` from now on, and count it in `excess`."""
        self.excess.setdefault(key, 0)

    def floods(self) -> list[str]:
        """Keys, ascending, that are muted and were not when this was asked last."""
        if len(self.excess) == len(self._told):
            return []
        new = sorted(self.excess.keys() - self._told)
        self._told.update(new)
        return new

    def pardon(self, key: str) -> int:
        """Take what comes on `key` again; returns how many samples were dropped."""
        self._told.discard(key)
        return self.excess.pop(key, 0)

    def get(self, timeout_s: float) -> Message | None:
        """The next message, or None if nothing came within `timeout_s` (wall time)."""
        while True:
            try:
                sample = self._samples.get(timeout=timeout_s)
            except queue.Empty:
                return None
            if type(sample) is deque:
                sample = sample.popleft()
            elif type(sample) is tuple:
                return sample
            key, data = str(sample.key_expr), sample.payload.to_bytes()
            mark = sample.attachment
            whole = data if mark is None else self._joined(key, mark.to_bytes(), data)
            if whole is not None:
                return key, whole

    def waiting(self) -> Iterator[Message]:
        """All messages that have come in so far. Those that come in meanwhile may never end, so they are left."""
        for _ in range(self._samples.qsize()):
            message = self.get(0.0)
            if message is None:
                return
            yield message

    def _joined(self, key: str, mark: bytes, data: bytes) -> bytes | None:
        """The whole message if this was its last part, else None."""
        if len(mark) != _MARK.size:
            return data  # not from a process of ours: its decoder will refuse it
        message, part, parts = _MARK.unpack(mark)
        if parts > _MOST_PARTS or len(data) > PART_BYTES:
            return None
        begun = self._begun.setdefault(key, {})
        if part == 0:
            if len(begun) == _SENDERS:  # its oldest message lacks a part that no longer comes
                del begun[next(iter(begun))]
            begun[message] = []
        got = begun.get(message)
        if got is None or len(got) != part:
            return None  # a part is missing
        got.append(data)
        if part + 1 < parts:
            return None
        return b"".join(begun.pop(message))
