"""The answers of the tick under way: which have come in, which the medium counted, and who left before the end."""

from __future__ import annotations

from bus.codec import WireError
from bus.envelopes import NO_TICK, Moves
from bus.lockstep import Gather
from world.attendance import Attendance
from world.config import WorldConfig
from world.core import DIED
from world.limits import decode_word
from world.messages import Motion, Report

__all__ = ["Turnout"]


class Turnout:
    """Gathers one tick after the other."""

    def __init__(self, attendance: Attendance, config: WorldConfig) -> None:
        self._attendance, self._config = attendance, config
        self._gather: Gather[Motion | Report] = Gather(-1, ())
        self._complete = NO_TICK
        """The last tick that the medium has said to be complete."""
        self._counted: frozenset[int] = frozenset()
        """Nodes whose transmission counted in it."""
        self._left: dict[int, tuple[int, str]] = {}
        """(token, cause) of nodes that left during the tick, until the medium says whether they still counted."""

    @property
    def tick(self) -> int:
        return self._gather.tick

    @property
    def missing(self) -> set[int]:
        """Nodes that the tick waits for."""
        return self._gather.missing

    @property
    def last(self) -> int | None:
        """The node that answered last."""
        return self._gather.last

    @property
    def complete(self) -> bool:
        """Whether the medium waits for no node either."""
        return self._complete >= self._gather.tick

    def __contains__(self, node: int) -> bool:
        """Whether `node` takes part in the tick, or has left it."""
        return node in self._gather

    def begin(self, tick: int, nodes: list[int]) -> None:
        """A tick begins in which `nodes` take part."""
        self._gather = Gather(tick, nodes)

    def leave(self, node: int, token: int, cause: str) -> bool:
        """Wait no longer for a node of this tick, where a process had the seat; False if it has left already."""
        if node in self._left:
            return False
        self._gather.depart(node)
        self._left[node] = token, cause
        return True

    def completed(self, moves: Moves) -> None:
        """The medium says whether it waits for any node still."""
        if moves.complete != NO_TICK:
            self._complete, self._counted = moves.complete, frozenset(moves.counted)

    def answer(self, node: int, token: int, tick: int, word: bytes) -> bool:
        """Take an answer; False if another process has the seat of its sender, which is to be refused.

        Raises:
            WireError: it is no answer of that node in that tick.
        """
        left = node in self._left and self._left[node][0] == token
        seated = self._attendance.seated(node, token)
        welcome = seated or not self._attendance.token(node)
        if not left and not seated:
            return welcome
        message = decode_word(node, word, self._config)
        if message.tick != tick:
            raise WireError(f"a motion of tick {message.tick} in an answer of tick {tick}")
        if left and tick == self.tick:
            # It died or was given up just after it had answered: the medium may have counted this answer.
            self._gather.keep(node, message)
        if seated and (tick != self.tick or not self._gather.add(node, message)):
            self._attendance.heard(node, token)
        return welcome or self._left.get(node, (0, DIED))[1] == DIED

    def close(self) -> tuple[list[tuple[int, str, bool]], dict[int, Motion | Report]]:
        """End the tick.

        Returns:
            (node, cause, whether its answer counted) of each that left, and the answers that counted by node.
        """
        answers, left = self._gather.messages, []
        for node, (_, cause) in self._left.items():
            counted = node in self._counted and node in answers
            left.append((node, cause, counted))
            if not counted:
                answers.pop(node, None)
        self._left.clear()
        return left, answers
