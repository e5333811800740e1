"""What several tests need: waiting for a condition, whether a process lives, and more examples of each property."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings

ROOT = Path(__file__).resolve().parent.parent

# A busy machine makes any example slow.
settings.register_profile("suite", settings(), deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")


def alive(pid: int) -> bool:
    """A process that is there and is no zombie."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"


def wait_until(condition: Callable[[], bool], timeout_s: float, what: str) -> None:
    """Return as soon as the condition holds; fail the test after `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"not within {timeout_s} s: {what}")
        time.sleep(0.01)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--examples-times", type=int, default=1, metavar="N", help="N times the examples of each property")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Function]) -> None:
    """A test's own number of examples would override that of a Hypothesis profile, so it is multiplied here."""
    times = config.getoption("--examples-times")
    for test in dict.fromkeys(item.obj for item in items if is_hypothesis_test(item.obj)):
        own = test._hypothesis_internal_use_settings
        test._hypothesis_internal_use_settings = settings(own, max_examples=times * own.max_examples)
