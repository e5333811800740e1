"""What travels together in a tick, still packed: each party opens its own part and passes the other's on unread.

A message costs far more than its bytes, so a node gets one and sends one in a tick. The world hands everybody's sense
to the medium, which adds the inbox; and a node's frames and motion go to the medium as one, which passes the motions of
a tick on together. So neither can come without the other: who has moved has also spoken.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from bus.codec import WireError, head, integer, pack, unpack

__all__ = ["NO_TICK", "Answer", "Moves", "Opening", "Turn"]

NO_TICK: Final = -1

_MOST: Final = 2**31 - 1
_TURN: Final = struct.Struct("<I")
"""Length of the sense."""
_ANSWER: Final = struct.Struct("<II")
"""Tick, length of the transmission."""


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


class Turn:
    """Medium -> node: it is its turn."""

    def __init__(self, sense: bytes, inbox: bytes) -> None:
        self.sense = sense
        """As the world sealed it."""
        self.inbox = inbox
        """Empty if nothing was to be heard: the node takes part for the first time."""

    def encode(self) -> bytes:
        return _TURN.pack(len(self.sense)) + self.sense + self.inbox

    @staticmethod
    def decode(data: bytes) -> Turn:
        (length,) = head(_TURN, data)
        end = _TURN.size + length
        if end > len(data):
            raise WireError("a turn is a sense and an inbox")
        return Turn(data[_TURN.size : end], data[end:])


class Answer:
    """Node -> medium: what it says and does in a tick. The parts repeat the tick, and must agree with it."""

    def __init__(self, tick: int, transmission: bytes, motion: bytes) -> None:
        self.tick = tick
        self.transmission = transmission
        self.motion = motion

    def encode(self) -> bytes:
        return _ANSWER.pack(self.tick, len(self.transmission)) + self.transmission + self.motion

    @staticmethod
    def decode(data: bytes) -> Answer:
        tick, length = head(_ANSWER, data)
        end = _ANSWER.size + length
        if tick > _MOST or end > len(data):
            raise WireError("an answer is a transmission and a motion")
        return Answer(tick, data[_ANSWER.size : end], data[end:])


class Moves(NamedTuple):
    """Medium -> world: what nodes answered, in the order in which it came in."""

    answers: Sequence[tuple[int, int, int, bytes]]
    """(node, incarnation of the token of its process, tick, motion)"""
    complete: int = NO_TICK
    """The tick that these answers complete: the medium waits for nobody any more, and nothing comes after."""
    counted: Sequence[int] = ()
    """Nodes whose transmission counts in that tick: all of the roster unless one departed during it."""

    def encode(self) -> bytes:
        return pack(self)

    @classmethod
    def decode(cls, data: bytes) -> Moves:
        answers, complete, counted = unpack(data, 3)
        if not isinstance(answers, list) or not isinstance(counted, list):
            raise WireError("moves and who counted are lists")
        for item in answers:
            if not isinstance(item, list) or len(item) != 4 or not isinstance(item[3], bytes):
                raise WireError("a move is (node, incarnation, tick, motion)")
            for value, most in zip(item, (_MOST, 2**32 - 1, _MOST), strict=False):
                integer(value, 0, most)
        return cls(
            [(node, token, tick, motion) for node, token, tick, motion in answers],
            integer(complete, NO_TICK, _MOST),
            [integer(node, 0, _MOST) for node in counted],
        )
