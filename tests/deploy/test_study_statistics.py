"""Statistics of studies, and the lower bounds of an arena."""

from __future__ import annotations

import math
import random

import pytest

from deploy.scenario import load
from deploy.sweep.bounds import bounds_of
from deploy.sweep.plan import Discard
from deploy.sweep.statistics import Interval, censored, goes_first, kept, mean_rates, median_of, ratio, share_of
from tests.helpers.studies import rates, row


def test_a_run_that_did_not_finish_counts_with_its_time_limit() -> None:
    found = censored([row(9, 9.0, 1, 500.0), row(9, 9.0, 2, None), row(9, 9.0, 3, 800.0)])
    assert (found.runs, found.finished) == (3, 2)
    assert found.mean_s.value == pytest.approx((500.0 + 2000.0 + 800.0) / 3)
    assert 500.0 <= found.mean_s.low < found.mean_s.value < found.mean_s.high <= 2000.0
    nothing = censored([row(9, 9.0, seed, None) for seed in (1, 2)])
    assert (nothing.finished, nothing.mean_s) == (0, Interval(2000.0, 2000.0, 2000.0))
    assert censored([row(9, 9.0, 1, 500.0)]).mean_s == Interval(500.0, 500.0, 500.0)
    assert censored([{**row(9, 9.0, 1, None), "search_time_s.1": 70.0}], "search_time_s.1").finished == 1


def test_the_interval_of_a_mean_covers_it_as_often_as_it_says() -> None:
    rng = random.Random(1)
    covered = 0
    for _ in range(60):
        mean_s = censored([row(9, 9.0, seed, rng.gauss(600.0, 100.0)) for seed in range(30)]).mean_s
        covered += mean_s.low <= 600.0 <= mean_s.high
    assert 50 <= covered < 60


def test_variants_are_compared_seed_by_seed() -> None:
    # Every run has exactly twice as much, so the spread between runs does not widen the interval.
    twice = ratio([(2.0, 1.0), (6.0, 3.0), (8.0, 4.0)])
    assert (twice.value, twice.low, twice.high) == (2.0, 2.0, 2.0)
    unlike = ratio([(1.0, 1.0), (1.0, 3.0), (4.0, 2.0)])
    assert unlike.value == 1.0
    assert unlike.low < 0.9
    assert unlike.high > 1.1
    assert unlike == ratio([(1.0, 1.0), (1.0, 3.0), (4.0, 2.0)]), "the same at each call"
    assert ratio([(3.0, 2.0)]) == Interval(1.5, 1.5, 1.5)


def test_a_median_and_a_share_have_their_intervals() -> None:
    sample = [float(k) for k in range(1, 102)]
    found = median_of(sample)
    assert (found.value, found) == (51.0, median_of(sample)), "the resamples are always the same ones"
    # By order statistics the interval of a median of 101 values is that from the 41st to the 61st.
    assert found.low == pytest.approx(41.0, abs=2.0)
    assert found.high == pytest.approx(61.0, abs=2.0)
    assert median_of([7.0]) == Interval(7.0, 7.0, 7.0)
    assert math.isnan(median_of([]).value)
    assert median_of([3000.0, 3000.0]) == median_of([3000.0] * 5)
    # Wilson's interval of 9 in 10: Newcombe 1998.
    share = share_of(9, 10)
    assert (share.value, round(share.low, 3), round(share.high, 3)) == (0.9, 0.596, 0.982)
    assert (share_of(10, 10).low, share_of(10, 10).high) == (pytest.approx(0.7225, abs=1e-3), 1.0)


def test_the_bounds_are_those_of_the_arena() -> None:
    bounds = bounds_of(load("three_cells"), [9])
    # The reading of Fig. 5 gives 61.2 m for the far corner of cell 2: 9.4, 6.6 and 5.1 m along the corridor.
    assert bounds.farthest_m == pytest.approx(61.2, abs=1.0)
    assert [bounds.corridor_m(n) for n in (6, 9, 12)] == pytest.approx([9.4, 6.6, 5.1], abs=0.1)
    assert bounds.t_low_s == pytest.approx(189.0, abs=3.0)
    assert sorted(bounds.radio_m) == [9]
    assert bounds.radio_m[9] < bounds.corridor_m(9) - 1.0


RULE = Discard("2", "1", 0.1)


@pytest.mark.parametrize(
    ("times", "series", "first"),
    [
        ((100.0, 200.0), rates([0.0, 0.0], [0.5, 0.5]), "1"),
        ((300.0, 200.0), rates([0.5, 0.5], [0.0, 0.0]), "2"),
        ((None, 200.0), rates([0.5, 0.5], [0.0, 0.0]), "2"),
        ((None, None), rates([0.0, 0.2], [0.0, 0.0]), "1"),
        ((None, None), rates([0.0, 0.2], [0.1, 0.1]), "2"),
        ((None, None), rates([0.0, 0.05], [0.0, 0.09]), None),
    ],
)
def test_which_cell_a_run_searched_first(
    times: tuple[float | None, float | None], series: dict[str, list[float]], first: str | None
) -> None:
    found = {**row(6, 9.0, 1, None), "search_time_s.1": times[0], "search_time_s.2": times[1]}
    assert goes_first(found, series, RULE) == first
    assert len(kept([found], {found["key"]: series}, RULE)) == (first != "2")
    assert len(kept([found], {found["key"]: series}, None)) == 1
    without = kept([found], {}, RULE)
    assert len(without) == (first != "2" or times == (None, None)), "nobody can tell where an unfinished run began"


def test_a_run_that_ended_keeps_its_rate() -> None:
    band = mean_rates([rates([0.0, 1.0], [0.0, 0.0]), rates([0.0, 0.0, 0.0], [0.0] * 3)], "1", 5.0)
    assert band.mean.tolist() == [0.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert band.low.min() >= 0.0
    assert band.high.max() <= 1.0
    assert band.n == 2
