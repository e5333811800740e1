"""A mutant, and the tests that hold each file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_TESTS: Final = "tests/agents/test_"

HELD_BY: Final[dict[str, tuple[str, ...]]] = {
    "agents/vds.py": (f"{_TESTS}paper_rules.py", f"{_TESTS}figure_4.py", f"{_TESTS}stalls.py"),
    "agents/srrc.py": (f"{_TESTS}figure_2.py", f"{_TESTS}paper_rules.py"),
    "agents/nms.py": (f"{_TESTS}ms_route.py", f"{_TESTS}routing.py"),
    "agents/explorer.py": (f"{_TESTS}stalls.py", f"{_TESTS}exploring.py"),
    "agents/dsdv.py": (f"{_TESTS}figure_2.py", f"{_TESTS}paper_rules.py", f"{_TESTS}routing.py"),
    "agents/forwarding_table.py": (
        f"{_TESTS}figure_2.py",
        "tests/oracles/test_loops.py::test_merged_tables",
        f"{_TESTS}routing.py",
    ),
    "monitor_station/search_rate.py": ("tests/monitor_station/test_search_rate.py",),
    "medium/core.py": ("tests/medium/test_delivery.py", "tests/medium/test_airtime.py"),
}
"""Tests of the files whose mutants are generated."""


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: str
    start: int
    end: int
    """The text of the file from `start` to `end` is replaced."""
    new: str
    what: str
    tests: tuple[str, ...]

    def text_of(self, original: str) -> str:
        """The file with the change."""
        return original[: self.start] + self.new + original[self.end :]
