"""What travels together in a tick, still packed: each party opens its own part and passes the other's on unread.

A message costs far more than its bytes, so a node gets one and sends one in a tick. The world hands everybody's sense
to the medium, which adds the inbox; and a node's frames and motion go to the medium as one, which passes the motions of
a tick on together. So neither can come without the other: who has moved has also spoken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from bus.codec import WireError, integer, pack, unpack

__all__ = ["Answer", "Moves", "Opening", "Turn"]

_MOST: int = 2**31 - 1


class Opening(NamedTuple):
    """World -> medium: a tick begins."""

    positions: bytes
    """Who takes part, and where they are."""
    senses: Sequence[tuple[int, bytes]]
    """By node, each behind a header that says for which process it is (`bus.lockstep.seal`)."""

    def encode(self) -> bytes:
        return pack(self)

    @classmethod
    def decode(cls, data: bytes) -> Opening:
        positions, senses = unpack(data, 2)
        if not isinstance(positions, bytes) or not isinstance(senses, list):
            raise WireError("an opening is positions and senses")
        for item in senses:
            if not isinstance(item, list) or len(item) != 2 or not isinstance(item[1], bytes):
                raise WireError("a sense is (node, bytes)")
            integer(item[0], 0, _MOST)
        return cls(positions, [(node, sense) for node, sense in senses])


class Turn(NamedTuple):
    """Medium -> node: it is its turn."""

    sense: bytes
    """As the world sealed it."""
    inbox: bytes | None
    """None if nothing was to be heard: the node takes part for the first time."""

    def encode(self) -> bytes:
        return pack(self)

    @classmethod
    def decode(cls, data: bytes) -> Turn:
        sense, inbox = unpack(data, 2)
        if not isinstance(sense, bytes) or not isinstance(inbox, bytes | None):
            raise WireError("a turn is a sense and an inbox")
        return cls(sense, inbox)


class Answer(NamedTuple):
    """Node -> medium: what it says and does in a tick. The parts repeat the tick, and must agree with it."""

    tick: int
    transmission: bytes
    motion: bytes

    def encode(self) -> bytes:
        return pack(self)

    @classmethod
    def decode(cls, data: bytes) -> Answer:
        tick, transmission, motion = unpack(data, 3)
        if not isinstance(transmission, bytes) or not isinstance(motion, bytes):
            raise WireError("an answer is a transmission and a motion")
        return cls(integer(tick, 0, _MOST), transmission, motion)


class Moves(NamedTuple):
    """Medium -> world: what nodes answered, in the order in which it came in."""

    answers: Sequence[tuple[int, int, int, bytes]]
    """(node, incarnation of the token of its process, tick, motion)"""

    def encode(self) -> bytes:
        return pack((self.answers,))

    @classmethod
    def decode(cls, data: bytes) -> Moves:
        (answers,) = unpack(data, 1)
        if not isinstance(answers, list):
            raise WireError("moves are a list")
        for item in answers:
            if not isinstance(item, list) or len(item) != 4 or not isinstance(item[3], bytes):
                raise WireError("a move is (node, incarnation, tick, motion)")
            for value, most in zip(item, (_MOST, 2**32 - 1, _MOST), strict=False):
                integer(value, 0, most)
        return cls([(node, token, tick, motion) for node, token, tick, motion in answers])
