"""The answers of the tick under way: which have come in, which the medium counted, and who left before the end."""

from __future__ import annotations

from bus.codec import WireError
from bus.envelopes import NO_TICK
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

    def completed(self, tick: int) -> None:
        """The medium waits for no node any more at `tick`, which may be NO_TICK."""
        self._complete = max(self._complete, tick)

    def answer(self, node: int, token: int, tick: int, word: bytes) -> bool:
        """Take an answer that the medium has counted; False if the process that sent it is to be refused.

        Raises:
            WireError: it is none of a node of this tick.
        """
        if tick != self.tick or node not in self:
            raise WireError(f"an answer of tick {tick} that counts in tick {self.tick}")
        config = self._config
        message = decode_word(node, tick, word, robots=config.robots, cells=len(config.cell_names))
        if self._gather.add(node, message):
            return True
        # It died or was given up just after it had answered.
        self._gather.keep(node, message)
        return self.stray(node, token)

    def stray(self, node: int, token: int) -> bool:
        """A process answers that no tick waits for; False if another has the seat of its node: it is to be refused."""
        if self._attendance.seated(node, token):
            self._attendance.heard(node, token)
            return True
        return self._left.get(node) == (token, DIED) or not self._attendance.token(node)

    def close(self) -> tuple[list[tuple[int, str, bool]], dict[int, Motion | Report]]:
        """End the tick.

        Returns:
            (node, cause, whether its answer counted) of each that left, and the answers by node.
        """
        answers = self._gather.messages
        left = [(node, cause, node in answers) for node, (_, cause) in self._left.items()]
        self._left.clear()
        return left, answers
