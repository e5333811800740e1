"""What the world puts on the bus in lockstep: to the medium, to nodes and to the launcher."""

from __future__ import annotations

from typing import Any

import msgpack

from bus.envelopes import Opening, Refused
from bus.lockstep import Kind, seal
from bus.session import Session
from world.feed import Signal
from world.messages import Departed, Stop

__all__ = ["Outlets"]


class Outlets:
    """The publishers of one run's world."""

    def __init__(self, session: Session, nodes: range) -> None:
        keys = session.keys
        self._put_words = [session.publisher(keys.word(node), blocking=True) for node in nodes]
        self._put_positions = session.publisher(keys.positions, blocking=True)
        self._put_signal = session.publisher(keys.signal, blocking=True)
        self._put_final = session.publisher(keys.final("world"), blocking=True)

    def open(self, opening: Opening) -> None:
        """A tick begins."""
        self._put_positions(seal(Kind.DATA, 0, opening.encode()))

    def departed(self, tick: int, node: int) -> None:
        """The medium waits for `node` no longer."""
        self._put_positions(seal(Kind.DEPARTED, 0, Departed(tick, node).encode()))

    def ping(self) -> None:
        """The medium passes on what it holds, and answers."""
        self._put_positions(seal(Kind.PING, 0))

    def refuse(self, node: int, token: int, why: str) -> None:
        """A process of `node` is told that it takes no part."""
        self._put_words[node](seal(Kind.REFUSED, token, Refused(why).encode()))

    def signal(self, order: Signal) -> None:
        """The launcher does something to a process."""
        self._put_signal(order.encode())

    def stop(self, stop: Stop, counts: dict[str, Any]) -> None:
        """The run ends. Launcher and medium come first: the link to a node may be full."""
        word = seal(Kind.STOP, 0, stop.encode())
        self._put_final(msgpack.packb(counts))
        self._put_positions(word)
        for put in self._put_words:
            put(word)
