"""Options of the suite: more examples of each property, and which build the short missions run in."""

from __future__ import annotations

import signal

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings

from deploy.machine.interrupts import SIGNALS

# A busy machine makes any example slow.
settings.register_profile("suite", settings(), deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")


# A runner that ignores signals, as nohup and a shell's `&` do, would hand that on to the commands under test.
for number in SIGNALS:
    signal.signal(number, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--examples-times", type=int, default=1, metavar="N", help="N times the examples of each property")
    parser.addoption("--tree", default=".", metavar="DIR", help="build that runs the missions with known digests")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Function]) -> None:
    """A test's own number of examples would override that of a Hypothesis profile, so it is multiplied here."""
    times = config.getoption("--examples-times")
    for test in dict.fromkeys(item.obj for item in items if is_hypothesis_test(item.obj)):
        own = test._hypothesis_internal_use_settings
        test._hypothesis_internal_use_settings = settings(own, max_examples=times * own.max_examples)
