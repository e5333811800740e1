"""Terms that all packages above `world` use: ticks, ids of nodes, classes and modes of robots, limits of numbers."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from bus.nodes import MAX_NODE, NOBODY, STATION

__all__ = [
    "MAX_NODE",
    "MAX_TICK",
    "MOST",
    "NOBODY",
    "STATION",
    "TICK_S",
    "UNREACHABLE",
    "Cls",
    "Mode",
    "NotNegative",
    "Place",
    "Positive",
    "Probability",
    "seconds_of",
    "tick_of",
]  # fmt: skip

TICK_S: Final = 0.1
"""Simulated seconds of one tick: the paper's interval between forwarding-table updates [paper 1.5, 2.5]."""

MAX_TICK: Final = 2**31 - 1

UNREACHABLE: Final = 255
"""Hop count of an infinite metric."""

MOST: Final = 1e9
"""No number of a scenario is larger, be it of seconds, metres or ticks: sums and products of them stay numbers."""
Positive = Annotated[float, Gt(0), Le(MOST)]
NotNegative = Annotated[float, Ge(0), Le(MOST)]
Probability = Annotated[float, Ge(0), Le(1)]


Place = tuple[float, float]
"""A position on the floor: x and y in metres."""


class Cls(IntEnum):
    """Class of a robot [paper 4.1]."""

    SR = 0
    RR = 1


class Mode(IntEnum):
    """What a robot is doing: the rule of its behavior algorithm that applies [paper 5.7]."""

    WALK = 0
    INNER = 1
    """Inner link recovery: traces its NMS."""
    OUTER = 2
    """Outer link recovery: traces its NMSR."""
    LOST = 3
    """No route to the MS: autonomous path recovery."""
    WAIT = 4
    """Stands still (no target, or a rule of the policy holds it)."""
    AWAY = 5
    """On a sortie: left the network on purpose, and will come back (docs/sortie.md)."""


def tick_of(at_s: float) -> int:
    """The tick at which simulated time `at_s` falls, or the number of ticks that a duration takes."""
    return round(at_s / TICK_S)


def seconds_of(ticks: int) -> float:
    """Simulated time of a tick, or of a number of ticks: without the last bits of `ticks * TICK_S`."""
    return round(ticks * TICK_S, 1)
