"""Who counts in a tick: the node whose answer the medium has counted, and nobody else."""

from __future__ import annotations

import pytest

from bus.codec import WireError
from tests.helpers.hand_driven import config
from world.attendance import Attendance
from world.core import DIED
from world.messages import Motion, Status
from world.turnout import Turnout

TICK = 3


def motion(tick: int = TICK) -> bytes:
    return Motion(tick, 0.1, 0.0, Status()).encode()


@pytest.fixture
def attendance() -> Attendance:
    attendance = Attendance()
    for node in (1, 2):
        assert attendance.came(node, 10 + node)
    attendance.arrivals()
    return attendance


@pytest.fixture
def turnout(attendance: Attendance) -> Turnout:
    turnout = Turnout(attendance, config(2))
    turnout.begin(TICK, [1, 2])
    return turnout


def test_a_stray_does_not_end_the_wait(turnout: Turnout) -> None:
    """As from a process that answers before its tick: the medium waits for another answer."""
    assert turnout.answer(1, 11, TICK, motion())
    assert turnout.stray(2, 12)
    assert turnout.missing == {2}
    assert turnout.leave(2, 12, "unresponsive")
    turnout.completed(TICK)
    left, answers = turnout.close()
    assert left == [(2, "unresponsive", False)]
    assert list(answers) == [1]


@pytest.mark.parametrize("cause", [DIED, "unresponsive"])
def test_who_leaves_after_its_answer_was_counted_took_part(turnout: Turnout, cause: str) -> None:
    assert turnout.answer(1, 11, TICK, motion())
    assert turnout.leave(2, 12, cause)
    assert not turnout.complete, "the medium may have counted it"
    assert turnout.answer(2, 12, TICK, motion())
    turnout.completed(TICK)
    assert turnout.complete
    left, answers = turnout.close()
    assert left == [(2, cause, True)]
    assert list(answers) == [1, 2]


@pytest.mark.parametrize(("node", "tick"), [(2, TICK - 1), (2, TICK + 1), (9, TICK)])
def test_no_answer_counts_but_of_a_node_of_this_tick(turnout: Turnout, node: int, tick: int) -> None:
    with pytest.raises(WireError):
        turnout.answer(node, 10 + node, tick, motion(tick))
    assert turnout.missing == {1, 2}


def test_who_may_answer_when_no_tick_waits(turnout: Turnout, attendance: Attendance) -> None:
    assert turnout.stray(1, 11), "the process that has the seat"
    assert not turnout.stray(1, 99), "a second one"
    attendance.silent(1)
    assert turnout.stray(1, 11)
    assert attendance.arrivals() == [(1, False)], "it was given up as hung, and is back"
    assert attendance.left(2, 12)
    turnout.leave(2, 12, DIED)
    assert attendance.came(2, 22)
    assert turnout.stray(2, 12), "it died before it could be refused"
    assert not turnout.stray(2, 99)
