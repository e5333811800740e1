"""Where the time of one process goes, by phase of its ticks: waiting, decode, routing, mapping, planning, encode, ...

A mark ends a phase: the time since the mark before it counts for that phase. Cores know no clock. The shell hands a
core the function that marks; the default one does nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgpack

from bus.codec import WireError, finite, text, unpacked

__all__ = ["REPORT_TICKS", "Mark", "Phases", "decode_phases", "unmarked"]

Mark = Callable[[str], None]

_MOST_PHASES: Final = 64

REPORT_TICKS: Final = 100
"""Ticks between two reports of a process."""


def unmarked(phase: str) -> None:
    """The mark of a core that is not measured."""


class Phases:
    """Seconds by phase, since the start."""

    __slots__ = ("_last_s", "_now_s", "spent_s")

    def __init__(self, now_s: Callable[[], float]) -> None:
        """`now_s`: the clock to read at every mark."""
        self._now_s = now_s
        self._last_s = now_s()
        self.spent_s: dict[str, float] = {}

    def skip(self) -> None:
        """Leave out the time since the last mark: it belongs to no tick."""
        self._last_s = self._now_s()

    def mark(self, phase: str) -> None:
        """End a phase."""
        now_s, spent_s = self._now_s(), self.spent_s
        spent_s[phase] = spent_s.get(phase, 0.0) + now_s - self._last_s
        self._last_s = now_s

    def encode(self) -> bytes:
        return msgpack.packb(self.spent_s)  # type: ignore[no-any-return]


def decode_phases(data: bytes) -> dict[str, float]:
    """Unpack what `Phases.encode` packed.

    Raises:
        WireError: not a map from text to numbers.
    """
    raw = unpacked(data)
    if not isinstance(raw, dict) or len(raw) > _MOST_PHASES:
        raise WireError("phases are a map of a few")
    return {text(phase, 40): finite(spent_s) for phase, spent_s in raw.items()}
