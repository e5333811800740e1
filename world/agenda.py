"""The faults of a run that are still to come, and the jams and losses that are in force."""

from __future__ import annotations

import math
from collections.abc import Sequence

from world.config import Fault
from world.faults import jam_of
from world.messages import Jam
from world.terms import tick_of

__all__ = ["Agenda"]


class Agenda:
    """What is due at which tick."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        """`faults`: those of the scenario."""
        self._scheduled: dict[int, list[Fault]] = {}
        self._by_hand: list[Fault] = []
        self._jams: list[tuple[int, Jam]] = []
        """(first tick without it, jam)"""
        self._losses: list[tuple[int, float]] = []
        """(first tick without it, probability)"""
        for fault in faults:
            self.schedule(fault)

    def add(self, fault: Fault) -> None:
        """Note a fault by hand: it is due at the next tick."""
        self._by_hand.append(fault)

    def schedule(self, fault: Fault) -> None:
        """Add a fault to those of the scenario, after those that are due at the same tick."""
        self._scheduled.setdefault(tick_of(fault.at_s), []).append(fault)

    def due(self, tick: int) -> bool:
        """Whether a fault acts at `tick`."""
        return bool(self._by_hand) or tick in self._scheduled

    def take(self, tick: int) -> list[tuple[Fault, bool]]:
        """Faults that act at `tick`, the scenario's first, each with whether it was made by hand."""
        by_hand, self._by_hand = self._by_hand, []
        return [(fault, False) for fault in self._scheduled.pop(tick, ())] + [(fault, True) for fault in by_hand]

    def revives(self) -> bool:
        """Whether a fault is still to come that brings a robot back, whatever became of it before."""
        to_come = [*self._by_hand, *(fault for due in self._scheduled.values() for fault in due)]
        return any(fault.verb == "restart" and fault.target.isdecimal() for fault in to_come)

    def disturb(self, fault: Fault, tick: int) -> None:
        """Let a jam or a loss begin at `tick`."""
        until = tick + tick_of(fault.for_s or 0.0)
        if fault.verb == "jam":
            self._jams.append((until, jam_of(fault.target)))
        else:
            self._losses.append((until, fault.probability))

    def jams(self, tick: int) -> tuple[Jam, ...]:
        """Jams in force at `tick`; asked with rising ticks."""
        self._jams = [(until, jam) for until, jam in self._jams if tick < until]
        return tuple(jam for _, jam in self._jams)

    def loss(self, tick: int) -> float:
        """Probability at `tick` that a receiver loses a frame, by all losses in force; asked with rising ticks."""
        self._losses = [(until, loss) for until, loss in self._losses if tick < until]
        return 1.0 - math.prod(1.0 - loss for _, loss in self._losses) if self._losses else 0.0
