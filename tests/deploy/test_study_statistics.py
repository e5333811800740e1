"""Statistics of studies, and the lower bounds of an arena."""

from __future__ import annotations

import math

import pytest

from deploy.scenario import load
from deploy.sweep.bounds import bounds_of
from deploy.sweep.plan import Discard
from deploy.sweep.statistics import estimate, goes_first, kept, mean_rates, ratio
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
