"""How long to wait for an acknowledgement before a report is sent again: RFC 6298, in ticks.

Its granularity G is a tick, and its minimum is the caller's. A report that was sent more than once measures nothing,
since nobody knows which copy was acknowledged (Karn's algorithm).
"""

from __future__ import annotations

from typing import Final

_ALPHA: Final = 1 / 8
_BETA: Final = 1 / 4
_MOST_DOUBLED: Final = 4
"""The wait is doubled with each time that a report is sent again, up to this many times."""


class RoundTrip:
    """The measured round trip between a robot and the MS."""

    def __init__(self) -> None:
        self._smoothed: float | None = None
        self._variation = 0.0

    def measure(self, ticks: int) -> None:
        """Take in the time between the only sending of a report and its acknowledgement."""
        if self._smoothed is None:
            self._smoothed, self._variation = float(ticks), ticks / 2
        else:
            self._variation += _BETA * (abs(self._smoothed - ticks) - self._variation)
            self._smoothed += _ALPHA * (ticks - self._smoothed)

    def patience_ticks(self, least: int, sent: int) -> float:
        """How long to wait for the acknowledgement of a report that was sent `sent` times, at least `least` ticks."""
        measured = 0.0 if self._smoothed is None else self._smoothed + max(1.0, 4.0 * self._variation)
        return max(least, measured) * 2.0 ** min(sent - 1, _MOST_DOUBLED)
