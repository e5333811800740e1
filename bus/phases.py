"""Where the time of one process goes, by phase of its ticks: waiting, decode, routing, mapping, planning, encode, ...

A mark ends a phase: the time since the mark before it is counted for that phase. The cores mark without knowing of a
clock: it is the shell that hands them a stopwatch, and a core without one marks nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import msgpack

from bus.codec import WireError, finite, text

__all__ = ["REPORT_TICKS", "Mark", "Phases", "decode_phases", "unmarked"]

Mark = Callable[[str], None]

REPORT_TICKS: Final = 100
"""Ticks between two reports of a process."""


def unmarked(phase: str) -> None:
    """The mark of a core that nobody measures."""


class Phases:
    """Seconds by phase, since the start."""

    __slots__ = ("_last_s", "_now_s", "spent_s")

    def __init__(self, now_s: Callable[[], float]) -> None:
        """Start with the clock to read at every mark."""
        self._now_s = now_s
        self._last_s = now_s()
        self.spent_s: dict[str, float] = {}

    def skip(self) -> None:
        """What happened since the last mark is no part of a tick."""
        self._last_s = self._now_s()

    def mark(self, phase: str) -> None:
        """A phase is over."""
        now_s, spent_s = self._now_s(), self.spent_s
        spent_s[phase] = spent_s.get(phase, 0.0) + now_s - self._last_s
        self._last_s = now_s

    def encode(self) -> bytes:
        return msgpack.packb(self.spent_s)  # type: ignore[no-any-return]


def decode_phases(data: bytes) -> dict[str, float]:
    """What `Phases.encode` packed.

    Raises:
        WireError: it is no map from text to numbers.
    """
    try:
        raw: Any = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise WireError("not msgpack") from error
    if not isinstance(raw, dict):
        raise WireError("phases are a map")
    return {text(phase, 40): finite(spent_s) for phase, spent_s in raw.items()}
