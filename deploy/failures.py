"""What went wrong in a run, for its user. What went wrong in the same way in many processes is told once."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from typing import Final, Self

from bus.culprit import culprit, from_users_code
from bus.excerpt import shown

__all__ = ["Crash", "Failures", "indented"]

_MOST_NAMED: Final = 5
_MOST_LINES: Final = 15
_LONGEST: Final = 200
"""Longest text of an exception in the first line."""
_LONGEST_LINE: Final = 300
"""Of a traceback."""


@dataclass(frozen=True)
class Crash:
    """An exception that ended a process, or a run in one process."""

    headline: str
    """What was raised, and where in the user's code."""
    traceback: str
    """From the user's code on; its last lines."""
    kind: str
    """Equal if two come from the same line: the text of an exception may differ by robot."""

    @classmethod
    def of(cls, error: BaseException) -> Self:
        where = culprit(error)
        what = shown(f"{type(error).__name__}: {error}".removesuffix(": "), _LONGEST)
        told = "".join(traceback.format_exception(type(error), error, from_users_code(error))).rstrip()
        return cls(
            f"{what} ({where})" if where and where not in what else what,
            "\n".join(shown(line, _LONGEST_LINE) for line in told.splitlines()[-_MOST_LINES:]),
            f"{type(error).__name__} {traceback.extract_tb(error.__traceback__)}",
        )


class Failures:
    """Failures in the order in which they came."""

    def __init__(self) -> None:
        self._told: list[str] = []
        self._alike: dict[str, tuple[int, list[str]]] = {}
        """By kind of a crash, the place of the first in `_told`, and who followed."""

    def add(self, words: str) -> None:
        """One more, in a line, perhaps with more lines below it."""
        self._told.append(words)

    def crashed(self, name: str, words: str, crash: Crash) -> None:
        """Process `name` was ended by an exception, which `words` say."""
        if crash.kind in self._alike:
            self._alike[crash.kind][1].append(name)
            return
        self._alike[crash.kind] = len(self._told), []
        self.add(f"{words}: {crash.headline}\n{indented(crash.traceback)}")

    def __bool__(self) -> bool:
        return bool(self._told)

    @property
    def lines(self) -> tuple[str, ...]:
        """One entry each, those in the same way together."""
        told = list(self._told)
        for place, others in self._alike.values():
            if others:
                more = ", ..." if len(others) > _MOST_NAMED else ""
                names = ", ".join(sorted(others, key=lambda name: (len(name), name))[:_MOST_NAMED])
                told[place] += f"\n    {len(others)} more failed in the same way: {names}{more}"
        return tuple(told)


def indented(text: str) -> str:
    """The lines below the first of a failure."""
    return "\n".join(f"    {line}" for line in text.splitlines())
