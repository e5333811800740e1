"""A pytest fixture for runs of real processes: `from deploy.testing import emulation` (docs/faults.md)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from deploy.emulation import Emulation, EmulationError

__all__ = ["Emulation", "EmulationError", "emulation"]


@pytest.fixture
def emulation(tmp_path: Path) -> Iterator[Callable[..., Emulation]]:
    """`emulation(scenario, faults=[...], robots=6, ...)` starts a run; all of them end with the test."""
    with contextlib.ExitStack() as runs:
        count = 0

        def start(scenario: str | Path = "three_cells", **options: Any) -> Emulation:
            nonlocal count
            count += 1
            return runs.enter_context(Emulation(scenario, tmp_path / f"run-{count}", **options))

        yield start
