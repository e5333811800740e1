"""Who is given up, and when, on a clock that the test sets."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.helpers.hand_driven import config
from world.silence import RunError, Silence

SLICE_S = 0.1
HANG_S, MEDIUM_S, RETURN_S = 2.0, 30.0, 10.0


class Wait:
    """One wait of the world, slice by slice; nothing comes in but what the medium answers."""

    def __init__(self, *, medium_answers: bool = True) -> None:
        self.now_s = 0.0
        self.pings = 0
        self.medium_answers = medium_answers
        made = config(hang_deadline_s=HANG_S, medium_deadline_s=MEDIUM_S, return_deadline_s=RETURN_S)
        self.silence = Silence(made, lambda: self.now_s, self._ping)
        self.silence.wait()

    def _ping(self) -> None:
        self.pings += 1

    def until(self, judge: Callable[[], list[int]], limit_s: float) -> list[int]:
        """Whom the first judgment that is not empty gives up, within `limit_s` from now."""
        end_s = self.now_s + limit_s
        while self.now_s < end_s:
            self.now_s += SLICE_S
            if self.medium_answers and self.silence.owed:
                self.silence.heard()
                self.silence.answered()
            if given_up := judge():
                return given_up
        return []


def test_a_silent_node_is_given_up_after_the_deadline_and_one_more_answer_of_the_medium() -> None:
    wait = Wait()
    assert wait.until(lambda: wait.silence.given_up({3, 1}, (), interrupted=False), 60.0) == [1, 3]
    # While an answer is owed the time does not count: at most every second slice does.
    assert HANG_S < wait.now_s <= 2 * HANG_S + 4 * SLICE_S
    assert wait.pings >= 2


def test_before_a_node_is_given_up_the_medium_passes_on_what_it_holds() -> None:
    """Others speak all the time, so nothing asks the medium for a sign of life before the deadline."""
    wait = Wait(medium_answers=False)

    def judge() -> list[int]:
        wait.silence.heard()
        return wait.silence.given_up({1}, (), interrupted=False)

    assert wait.until(judge, HANG_S - SLICE_S) == []
    assert wait.pings == 0
    assert wait.until(judge, 5.0) == []
    assert wait.pings == 1
    wait.silence.answered()
    assert judge() == [1]


def test_a_node_at_its_first_tick_has_the_deadline_of_a_return() -> None:
    wait = Wait()
    assert wait.until(lambda: wait.silence.given_up({1, 2}, {1}, interrupted=False), 60.0) == [2]
    assert wait.until(lambda: wait.silence.given_up({1}, {1}, interrupted=False), 60.0) == [1]
    assert wait.now_s > RETURN_S


def test_nobody_is_excused_once_the_run_is_interrupted() -> None:
    wait = Wait()
    assert wait.until(lambda: wait.silence.given_up({1, 2}, {1}, interrupted=True), 60.0) == [1, 2]


def test_past_a_medium_that_does_not_answer_no_node_is_given_up() -> None:
    wait = Wait(medium_answers=False)
    assert wait.until(lambda: wait.silence.given_up({1}, (), interrupted=False), MEDIUM_S - 1.0) == []
    assert (wait.pings, wait.silence.owed) == (1, 1)
    with pytest.raises(RunError, match="the medium was silent for 30 s"):
        wait.until(lambda: wait.silence.given_up({1}, (), interrupted=False), 2.0)


def test_a_medium_that_came_back_leaves_no_node_out() -> None:
    wait = Wait(medium_answers=False)
    wait.until(lambda: wait.silence.given_up({1}, (), interrupted=False), 20.0)
    wait.medium_answers = True
    assert wait.until(lambda: wait.silence.given_up({1}, (), interrupted=False), HANG_S / 2) == []


@pytest.mark.parametrize(("interrupted", "deadline_s"), [(False, MEDIUM_S), (True, HANG_S)])
def test_the_medium_alone_has_a_deadline_of_its_own(interrupted: bool, deadline_s: float) -> None:
    wait = Wait()

    def judge() -> list[int]:
        wait.silence.check_medium(interrupted=interrupted)
        return []

    assert wait.until(judge, deadline_s - 1.0) == []
    with pytest.raises(RunError):
        wait.until(judge, 2.0)
