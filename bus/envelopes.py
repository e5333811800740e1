"""Envelopes: messages that travel together in a tick, still packed. Each party opens its own part and no other.

A message costs far more than its bytes, so a node gets one and sends one in a tick. The world hands the senses of all
nodes to the medium, which adds the inbox of each. A node's frames and motion go to the medium as one message, and the
medium passes the motions of a tick on together. So no motion arrives without its frames.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from bus.codec import WireError, head, pack, text, unpack

__all__ = ["NO_TICK", "Answer", "Flood", "Moves", "Opening", "Refused", "Turn"]

NO_TICK: Final = -1

_MOST: Final = 2**31 - 1
_OPENING: Final = struct.Struct("<II")
"""Length of the positions, number of senses."""
_SENSE: Final = struct.Struct("<II")
"""Node, length."""
_MOVES: Final = struct.Struct("<iII")
"""The tick that is complete, number of strays, number of answers."""
_STRAY: Final = struct.Struct("<II")
"""Node, incarnation."""
_MOVE: Final = struct.Struct("<IIII")
"""Node, incarnation, tick, length of the motion."""
_TURN: Final = struct.Struct("<I")
"""Length of the sense."""
_FLOOD: Final = struct.Struct("<I")
"""Node."""
_ANSWER: Final = struct.Struct("<II")
"""Tick, length of the transmission."""


@dataclass(slots=True, init=False)
class Opening:
    """World -> medium: a tick begins."""

    positions: bytes
    """`Positions`: the nodes that take part, and where they are."""
    senses: Sequence[tuple[int, bytes]]
    """(node, `Sense`), each behind a header that names the process that it is for (`bus.lockstep.seal`)."""

    def __init__(self, positions: bytes, senses: Sequence[tuple[int, bytes]]) -> None:
        self.positions = positions
        self.senses = senses

    def encode(self) -> bytes:
        parts = [_OPENING.pack(len(self.positions), len(self.senses))]
        parts += [_SENSE.pack(node, len(sense)) for node, sense in self.senses]
        parts.append(self.positions)
        parts += [sense for _, sense in self.senses]
        return b"".join(parts)

    @staticmethod
    def decode(data: bytes) -> Opening:
        length, count = head(_OPENING, data)
        at = _OPENING.size + _SENSE.size * count
        heads, positions = data[_OPENING.size : at], data[at : at + length]
        at += length
        if at > len(data):
            raise WireError("an opening is positions and senses")
        senses: list[tuple[int, bytes]] = []
        for node, size in _SENSE.iter_unpack(heads):
            senses.append((node, data[at : at + size]))
            at += size
        if at != len(data):
            raise WireError("senses have another length than they say")
        return Opening(positions, senses)


@dataclass(slots=True, init=False)
class Turn:
    """Medium -> node: the node's turn begins."""

    sense: bytes
    """With the header that the world put before it."""
    inbox: bytes
    """Empty at the first tick of a node, which has no inbox."""

    def __init__(self, sense: bytes, inbox: bytes) -> None:
        self.sense = sense
        self.inbox = inbox

    def encode(self) -> bytes:
        return _TURN.pack(len(self.sense)) + self.sense + self.inbox

    @staticmethod
    def decode(data: bytes) -> Turn:
        (length,) = head(_TURN, data)
        end = _TURN.size + length
        if end > len(data):
            raise WireError("a turn is a sense and an inbox")
        return Turn(data[_TURN.size : end], data[end:])


@dataclass(slots=True, init=False)
class Answer:
    """Node -> medium: the frames and the motion of a tick. Both parts repeat the tick and must agree with it."""

    tick: int
    transmission: bytes
    motion: bytes

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


@dataclass(slots=True, init=False)
class Moves:
    """Medium -> world: who answered, in the order in which the answers came in."""

    answers: Sequence[tuple[int, int, int, bytes]]
    """(node, incarnation of the token of its process, tick, motion) of each answer that counts in the tick under way:
    its frames go on the air, and the digest has them."""
    complete: int
    """The tick that these answers complete, or NO_TICK. The medium waits for no more; later ones are too late."""
    strays: Sequence[tuple[int, int]]
    """(node, incarnation) of each process that answered though no tick waited for it: nothing of that counts."""

    def __init__(
        self,
        answers: Sequence[tuple[int, int, int, bytes]],
        complete: int = NO_TICK,
        strays: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.answers = answers
        self.complete = complete
        self.strays = strays

    def encode(self) -> bytes:
        parts = [_MOVES.pack(self.complete, len(self.strays), len(self.answers))]
        parts += [_STRAY.pack(node, token) for node, token in self.strays]
        parts += [_MOVE.pack(node, token, tick, len(motion)) for node, token, tick, motion in self.answers]
        parts += [motion for _, _, _, motion in self.answers]
        return b"".join(parts)

    @staticmethod
    def decode(data: bytes) -> Moves:
        complete, strays, count = head(_MOVES, data)
        start = _MOVES.size + _STRAY.size * strays
        at = start + _MOVE.size * count
        if complete < NO_TICK or at > len(data):
            raise WireError("moves are answers and strays")
        answers: list[tuple[int, int, int, bytes]] = []
        for node, token, tick, size in _MOVE.iter_unpack(data[start:at]):
            answers.append((node, token, tick, data[at : at + size]))
            at += size
        if at != len(data):
            raise WireError("motions have another length than they say")
        return Moves(answers, complete, list(_STRAY.iter_unpack(data[_MOVES.size : start])))


@dataclass(frozen=True, slots=True)
class Flood:
    """Medium -> world: a node put more messages than can wait, and is not heard any more until it is admitted anew."""

    node: int

    def encode(self) -> bytes:
        return _FLOOD.pack(self.node)

    @staticmethod
    def decode(data: bytes) -> Flood:
        if len(data) != _FLOOD.size:
            raise WireError("a flood is a node")
        return Flood(*_FLOOD.unpack(data))


@dataclass(frozen=True, slots=True)
class Refused:
    """World -> one process of a node: it takes no part, and why. All versions of the wire have it in this form."""

    why: str
    """One line for its user."""

    def encode(self) -> bytes:
        return pack((self.why,))

    @staticmethod
    def decode(data: bytes) -> Refused:
        (why,) = unpack(data, 1)
        return Refused(text(why))
