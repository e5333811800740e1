"""How a run may have ended: the statuses of summary.json and of the rows of a study, and what each means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["ERROR", "STATUSES", "Status", "meaning_of"]


@dataclass(frozen=True)
class Status:
    """The meaning of a status."""

    words: str
    """For a reader."""
    kind: Literal["good", "soft", "bad"]
    result: bool
    """Whether the run has a result: it went on until it was searched or out of time. Figures show no other."""
    complete: bool
    """Whether the run came to its own end, so that its repetition ends as well, with the same digest."""
    as_asked: bool
    """Whether the run ended as its user asked; if not, the command exits with status 1."""


ERROR: Final = "error"
"""Status of a row of a study whose run ended by an exception, or fell short; column `error` has its text."""

STATUSES: Final = {
    "searched": Status("all cells searched", "good", result=True, complete=True, as_asked=True),
    "time_limit": Status("time limit reached", "soft", result=True, complete=True, as_asked=True),
    # As asked, if what can be searched is finished all the same (summary.shortfall).
    "exhausted": Status("no frontier left", "soft", result=True, complete=True, as_asked=False),
    "interrupted": Status("interrupted", "soft", result=False, complete=False, as_asked=True),
    "no_robots": Status("no robot left", "bad", result=False, complete=True, as_asked=False),
    "failed": Status("failed", "bad", result=False, complete=False, as_asked=False),
    ERROR: Status("failed", "bad", result=False, complete=False, as_asked=False),
}


def meaning_of(status: object) -> Status:
    """The meaning of a status as a file has it; of one that nobody knows, that it is no result."""
    known = STATUSES.get(status) if isinstance(status, str) else None
    return known or Status(str(status), "bad", result=False, complete=False, as_asked=False)
