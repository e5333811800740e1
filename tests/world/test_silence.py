"""Who is given up, and when, on a clock that the test sets."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.helpers.hand_driven import config
from world.silence import RunError, Silence

SLICE_S = 0.1
HANG_S, THINK_S, MEDIUM_S = 2.0, 60.0, 30.0
BEAT_SLICES = 3
Hung = list[tuple[int, str]]


class Wait:
    """One wait of the world, slice by slice; nothing comes in but what the medium answers."""

    def __init__(self, *, medium_answers: bool = True) -> None:
        self.now_s = 0.0
        self.pings = 0
        self.medium_answers = medium_answers
        self.works: dict[int, Callable[[], float]] = {}
        """By node that beats: the processor time that it has spent on its turn."""
        made = config(hang_deadline_s=HANG_S, think_deadline_s=THINK_S, medium_deadline_s=MEDIUM_S)
        self.silence = Silence(made, lambda: self.now_s, self._ping)
        self.silence.wait()

    def _ping(self) -> None:
        self.pings += 1

    def given_up(self, missing: set[int], *, limit_s: float = 120.0, interrupted: bool = False) -> Hung:
        """Whom of those that the tick waits for it gives up first."""
        return self.until(lambda: self.silence.given_up(missing, interrupted=interrupted), limit_s)

    def until(self, judge: Callable[[], Hung], limit_s: float) -> Hung:
        """Whom the first judgment that is not empty gives up, within `limit_s` from now."""
        end_s = self.now_s + limit_s
        slices = 0
        while self.now_s < end_s:
            self.now_s += SLICE_S
            slices += 1
            if slices % BEAT_SLICES == 0:
                for node, spent_s in self.works.items():
                    self.silence.heard()
                    assert self.silence.beat(node, spent_s(), counts=True)
            if self.medium_answers and self.silence.owed:
                self.silence.heard()
                self.silence.answered()
            if given_up := judge():
                return given_up
        return []


def test_a_silent_node_is_given_up_after_the_deadline_and_one_more_answer_of_the_medium() -> None:
    wait = Wait()
    assert wait.given_up({3, 1}) == [(1, "unresponsive"), (3, "unresponsive")]
    # While an answer is owed the time does not count: at most every second slice does.
    assert HANG_S < wait.now_s <= 2 * HANG_S + 4 * SLICE_S
    assert wait.pings >= 2


def test_before_a_node_is_given_up_the_medium_passes_on_what_it_holds() -> None:
    """Others speak all the time, so nothing asks the medium for a sign of life before the deadline."""
    wait = Wait(medium_answers=False)

    def judge() -> Hung:
        wait.silence.heard()
        return wait.silence.given_up({1}, interrupted=False)

    assert wait.until(judge, HANG_S - SLICE_S) == []
    assert wait.pings == 0
    assert wait.until(judge, 5.0) == []
    assert wait.pings == 1
    wait.silence.answered()
    assert judge() == [(1, "unresponsive")]


def test_a_node_that_works_is_waited_for_until_it_has_thought_for_too_long() -> None:
    wait = Wait()
    begun_s = wait.now_s
    wait.works[1] = lambda: 0.9 * (wait.now_s - begun_s)
    assert wait.given_up({1, 2}) == [(2, "unresponsive")]
    assert wait.given_up({1}, limit_s=THINK_S) == []
    assert wait.given_up({1}) == [(1, "thinks for more than 60 s")]
    assert 0.9 * wait.now_s > THINK_S


def test_a_node_that_starves_is_waited_for_and_one_that_only_beats_is_not() -> None:
    """One gets a fiftieth of a processor, the other sleeps and looks ten times a second whether it may go on."""
    wait = Wait()
    wait.works = {1: lambda: wait.now_s / 50, 2: lambda: wait.now_s * 10 * 5e-5}
    assert wait.given_up({1, 2}) == [(2, "unresponsive")]
    assert wait.now_s < 3 * HANG_S
    assert wait.given_up({1}) == []


def test_a_node_that_stops_working_is_given_up_after_the_deadline() -> None:
    wait = Wait()
    wait.works[1] = lambda: min(wait.now_s, 10.0)
    assert wait.given_up({1}) == [(1, "unresponsive")]
    assert 10.0 + HANG_S < wait.now_s < 10.0 + 3 * HANG_S


def test_processor_time_counts_from_the_turn_on() -> None:
    """The station may still be at its recording when the next tick begins: its beats then begin anew with its turn."""
    wait = Wait()
    wait.works[0] = lambda: wait.now_s if wait.now_s < 50.0 else wait.now_s - 50.0
    assert wait.given_up({0}, limit_s=100.0) == []


def test_a_process_without_a_seat_works_for_nobody() -> None:
    wait = Wait()
    assert wait.silence.beat(1, 1.0, counts=False)
    assert wait.given_up({1}, limit_s=2 * HANG_S + 1.0) == [(1, "unresponsive")]


def test_a_node_that_beats_too_often_is_told_from_an_honest_one() -> None:
    """Two honest processes beat four times a second each, and the world may not have listened for minutes."""
    silence = Wait().silence
    assert all(silence.beat(1, 1.0, counts=True) for _ in range(120 * 2 * 4))
    assert not all(silence.beat(1, 1.0, counts=True) for _ in range(120 * 2 * 4))


def test_an_interrupted_run_waits_for_nobody_who_works() -> None:
    wait = Wait()
    wait.works[1] = lambda: wait.now_s
    assert wait.given_up({1, 2}, interrupted=True) == [(1, "unresponsive"), (2, "unresponsive")]
    assert wait.now_s < 2 * HANG_S


def test_past_a_medium_that_does_not_answer_no_node_is_given_up() -> None:
    wait = Wait(medium_answers=False)
    assert wait.given_up({1}, limit_s=MEDIUM_S - 1.0) == []
    assert (wait.pings, wait.silence.owed) == (1, 1)
    with pytest.raises(RunError, match="the medium was silent for 30 s"):
        wait.given_up({1}, limit_s=2.0)


def test_a_medium_that_came_back_leaves_no_node_out() -> None:
    wait = Wait(medium_answers=False)
    wait.given_up({1}, limit_s=20.0)
    wait.medium_answers = True
    assert wait.given_up({1}, limit_s=HANG_S / 2) == []


@pytest.mark.parametrize(("interrupted", "deadline_s"), [(False, MEDIUM_S), (True, HANG_S)])
def test_the_medium_alone_has_a_deadline_of_its_own(interrupted: bool, deadline_s: float) -> None:
    wait = Wait()

    def judge() -> Hung:
        wait.silence.check_medium(interrupted=interrupted)
        return []

    assert wait.until(judge, deadline_s - 1.0) == []
    with pytest.raises(RunError):
        wait.until(judge, 2.0)
