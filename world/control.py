"""Commands of an operator to a run under way: its pace, and faults by hand."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from typing import Any

from world.config import Fault
from world.faults import check_fault, describe, parse_fault
from world.pace import Pace

__all__ = ["Control"]


class Control:
    """Answers the operator in a thread of the session. Faults wait until the world takes them in its own."""

    def __init__(
        self, pace: Pace, robots: int, status: Callable[[], dict[str, Any]], external: tuple[int, ...] = ()
    ) -> None:
        """`status`: how the run stands, JSON types; part of every answer. `external`: robots that no fault stops."""
        self._pace, self._robots, self._status, self._external = pace, robots, status, external
        self._faults: deque[Fault] = deque()

    def answer(self, line: str) -> str:
        """Obey one of `pace.COMMANDS`; returns JSON."""
        word, _, rest = line.partition(" ")
        if word != "fault":
            return self._pace.command(line, self._status)
        try:
            fault = parse_fault(rest)
            check_fault(fault, self._robots, external=self._external)
        except ValueError as error:
            return json.dumps({"error": str(error)})
        self._faults.append(fault)
        return json.dumps(self._status() | {"fault": describe(fault)})

    def take(self) -> list[Fault]:
        """Faults by hand since the last call."""
        return [self._faults.popleft() for _ in range(len(self._faults))]
