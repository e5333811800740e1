"""Statistics of studies, and the lower bounds of an arena."""

from __future__ import annotations

import math

import pytest

from deploy.scenario import load
from deploy.sweep.bounds import bounds_of
from deploy.sweep.plan import Discard
from deploy.sweep.statistics import estimate, goes_first, kept, mean_rates, median_of, ratio, share_of
from tests.helpers.studies import rates, row


def test_the_confidence_interval_is_students() -> None:
    found = estimate([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found.mean == 3.0
    # t(0.975, 4) = 2.7764, s = sqrt(2.5)
    assert found.half_width == pytest.approx(2.77645 * math.sqrt(2.5) / math.sqrt(5), rel=1e-5)
    assert estimate([]).n == 0
    # Every run has exactly twice as much, so the spread between runs does not widen the interval.
    assert (ratio([(2.0, 1.0), (6.0, 3.0)]).mean, ratio([(2.0, 1.0), (6.0, 3.0)]).half_width) == (2.0, 0.0)
    unlike = ratio([(1.0, 1.0), (1.0, 3.0), (4.0, 2.0)])
    assert unlike.mean == 1.0
    assert unlike.half_width == pytest.approx(4.303 * 2.0 / math.sqrt(3.0) / 2.0, rel=1e-3)
    assert math.isnan(estimate([7.0]).half_width)


def test_a_median_and_a_share_have_their_intervals() -> None:
    sample = [float(k) for k in range(1, 102)]
    found = median_of(sample)
    assert (found.value, found) == (51.0, median_of(sample)), "the resamples are always the same ones"
    # By order statistics the interval of a median of 101 values is that from the 41st to the 61st.
    assert found.low == pytest.approx(41.0, abs=2.0)
    assert found.high == pytest.approx(61.0, abs=2.0)
    assert (median_of([7.0]).value, math.isnan(median_of([7.0]).low)) == (7.0, True)
    assert math.isnan(median_of([]).value)
    assert median_of([3000.0, 3000.0]) == median_of([3000.0] * 5)
    # Wilson's interval of 9 in 10: Newcombe 1998.
    share = share_of(9, 10)
    assert (share.value, round(share.low, 3), round(share.high, 3)) == (0.9, 0.596, 0.982)
    assert (share_of(10, 10).low, share_of(10, 10).high) == (pytest.approx(0.7225, abs=1e-3), 1.0)


def test_the_bounds_are_those_of_the_arena() -> None:
    bounds = bounds_of(load("three_cells"))
    # The reading of Fig. 5 gives 61.2 m for the far corner of cell 2, and r_low 9.4, 6.6 and 5.1 m.
    assert bounds.farthest_m == pytest.approx(61.2, abs=1.0)
    assert [bounds.r_low_m(n) for n in (6, 9, 12)] == pytest.approx([9.4, 6.6, 5.1], abs=0.1)
    assert bounds.t_low_s == pytest.approx((189.0, 229.0), abs=3.0)


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


def test_a_run_that_ended_keeps_its_rate() -> None:
    band = mean_rates([rates([0.0, 1.0], [0.0, 0.0]), rates([0.0, 0.0, 0.0], [0.0] * 3)], "1", 5.0)
    assert band.mean.tolist() == [0.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert band.low.min() >= 0.0
    assert band.high.max() <= 1.0
    assert band.n == 2
