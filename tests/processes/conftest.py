"""Fixtures of the tests that start real processes."""

from __future__ import annotations

import multiprocessing.forkserver
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.running import Running
from tests.helpers.waiting import alive, wait_until


@pytest.fixture(scope="module", autouse=True)
def own_fork_server() -> Iterator[None]:
    """A program has one fork server only, with the modules and the environment of whoever started it."""
    multiprocessing.forkserver._forkserver._stop()  # type: ignore[attr-defined]
    yield
    multiprocessing.forkserver._forkserver._stop()  # type: ignore[attr-defined]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start runs, each in a folder of its own; whatever is left of them is ended after the test."""
    runs: list[Running] = []

    def begin(*arguments: object, **how: Any) -> Running:
        runs.append(Running(tmp_path / f"run-{len(runs)}", *arguments, **how))
        return runs[-1]

    yield begin
    for each in runs:
        if each.session is not None:
            each.session.close()
        pids = [pid for name, pid in each.pids().items() if name != "launcher"]
        with each.process:  # whatever a test has read of it, or has closed
            each.process.kill()
        wait_until(lambda pids=pids: not any(map(alive, pids)), "no process is left")  # type: ignore[misc]
