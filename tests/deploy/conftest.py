"""Fixtures of the tests of scenarios, studies and reports."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from deploy.sweep.results import Results


@pytest.fixture
def claimed() -> Iterator[Callable[[Path], Results]]:
    """Results in a folder that belongs to this test."""
    with contextlib.ExitStack() as held:

        def claim(folder: Path) -> Results:
            results = held.enter_context(contextlib.closing(Results(folder)))
            results.claim()
            return results

        yield claim
