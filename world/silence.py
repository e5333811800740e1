"""Silence in a tick, and whose fault it is: a node's that hangs, or the medium's, through which all messages come.

The medium hosts the router, so nothing reaches the world from any node while the medium is stopped. A silence therefore
counts against nodes only while the medium answers pings, and before a node is given up the medium passes on what it
holds.

A node that works is not silent. Its beats tell how much processor time it has spent on its turn. It hangs when that
does not grow for the deadline of a node that hangs, or has grown beyond what a turn may take.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

from bus.lockstep import Patience
from world.config import WorldConfig

__all__ = ["RunError", "Silence"]

_PING_AFTER_S: Final = Patience.SLICE_S / 2
"""The medium is pinged once nothing has come in for this long."""
_INTERRUPTED_S: Final = 1.0
"""How long an interrupted run waits for a node, whether it works or not: its operator waits, too."""
_WORK_S: Final = 0.02
"""Processor time that shows work: a hundredth of two seconds. A process that waits for something else, and looks from
time to time whether it is there, spends less."""

_MOST_BEATS: Final = 1000
_MOST_BEATS_PER_S: Final = 10.0
"""An honest process beats four times a second, and a node may have two."""


class RunError(Exception):
    """The run can't go on: a process that it needs is not there, or does not answer."""


class Silence:
    """Judges the silence of nodes, then of the medium, in one tick after the other."""

    def __init__(self, config: WorldConfig, now_s: Callable[[], float], ping: Callable[[], None]) -> None:
        """Judge by the deadlines of a run.

        Args:
            config: of the run.
            now_s: the wall clock.
            ping: sends the medium a ping, which it answers once it has passed on all that it holds.
        """
        self._config = config
        self._now_s = now_s
        self._ping = ping
        self._owing: Patience | None = None
        """Since when the medium owes an answer."""
        self._answers = 0
        self._heard_s = self._now_s()
        """When something came in last."""
        self._waited = Patience(self._heard_s)
        """How long the tick has waited, for its nodes or then for the medium."""
        self._sure: int | None = None
        """The count of answers at which the medium has passed on all that it held at the nodes' deadline."""
        self._begun_s = self._heard_s
        self._beats: dict[int, int] = {}
        """By node: its beats so far."""
        self._worked: dict[int, tuple[float, float]] = {}
        """By node, when it last showed work: processor time spent on its turn, and how long the tick had waited."""

    def heard(self) -> None:
        """Something came in."""
        self._heard_s = self._now_s()

    def answered(self) -> None:
        """The medium answered a ping."""
        self._owing = None
        self._answers += 1

    @property
    def owed(self) -> int:
        """Pings that the medium has not answered: 0 or 1."""
        return int(self._owing is not None)

    def wait(self) -> None:
        """A wait begins: for the nodes of a tick, or for the medium."""
        self._waited = Patience(self._now_s())
        self._sure = None
        self._worked.clear()

    def beat(self, node: int, spent_s: float, *, counts: bool) -> bool:
        """A beat of `node` came in, whose process has spent so much processor time on its turn.

        `counts`: it comes from the process that takes part. Returns False if the node beats too often.
        """
        before_s, _ = self._worked.get(node, (0.0, 0.0))
        if counts and not before_s <= spent_s < before_s + _WORK_S:  # less than before: in another turn
            self._worked[node] = spent_s, self._waited.waited_s
        beats = self._beats[node] = self._beats.get(node, 0) + 1
        return beats < _MOST_BEATS + _MOST_BEATS_PER_S * (self._now_s() - self._begun_s)

    def pardon(self, node: int) -> None:
        """A new process of `node` came: the beats of the ones before do not count."""
        self._beats.pop(node, None)

    def given_up(self, missing: Collection[int], *, interrupted: bool) -> list[tuple[int, str]]:
        """(node, cause) of each that is to be given up, ascending; to be asked in every slice of a wait for nodes.

        Args:
            missing: nodes that the tick waits for; not empty.
            interrupted: the run is to end: no node is waited for because it works.

        Raises:
            RunError: the medium does not answer.
        """
        now_s = self._now_s()
        if not self._medium_answers(now_s, interrupted=interrupted):
            self._waited.excuse(now_s)
            return []
        waited_s = self._waited.wait(now_s)
        if waited_s <= (_INTERRUPTED_S if interrupted else self._config.hang_deadline_s):
            return []
        hung = [
            (node, cause)
            for node in sorted(missing)
            if (cause := "unresponsive" if interrupted else self._cause(node, waited_s))
        ]
        if not hung:
            self._sure = None
            return []
        if self._sure is None:
            self._sure = self._answers + 1
            self._ask(now_s)
        if self._answers < self._sure:
            return []
        self._sure = None
        return hung

    def _cause(self, node: int, waited_s: float) -> str:
        """Why `node` is to be given up; empty if it is not."""
        spent_s, since_s = self._worked.get(node, (0.0, 0.0))
        if spent_s > self._config.think_deadline_s:
            return f"thinks for more than {self._config.think_deadline_s:g} s"
        return "unresponsive" if waited_s - since_s > self._config.hang_deadline_s else ""

    def check_medium(self, *, interrupted: bool) -> None:
        """Check the medium's deadline; to be called in every slice of a wait for the medium.

        Raises:
            RunError: it has done so for longer than the medium's deadline.
        """
        self._hold_to_deadline(self._waited.wait(self._now_s()), interrupted=interrupted)

    def _medium_answers(self, now_s: float, *, interrupted: bool) -> bool:
        if self._owing is None:
            if now_s - self._heard_s > _PING_AFTER_S:
                self._ask(now_s)
            return True
        self._hold_to_deadline(self._owing.wait(now_s), interrupted=interrupted)
        return False

    def _hold_to_deadline(self, waited_s: float, *, interrupted: bool) -> None:
        deadline_s = self._config.hang_deadline_s if interrupted else self._config.medium_deadline_s
        if waited_s > deadline_s:
            raise RunError(f"the medium was silent for {deadline_s:g} s")

    def _ask(self, now_s: float) -> None:
        """Ping the medium, unless it owes an answer."""
        if self._owing is None:
            self._owing = Patience(now_s)
            self._ping()
