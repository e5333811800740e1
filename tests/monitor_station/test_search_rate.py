"""Search rates of cells, whether they lie apart, overlap or nest."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from monitor_station.config import SearchCell
from monitor_station.search_rate import SearchRate

SIZE = 20
members = st.sets(st.integers(0, SIZE - 1), min_size=1)


@given(st.lists(members, min_size=1, max_size=6), st.lists(st.sets(st.integers(0, SIZE - 1)), max_size=6))
def test_each_cell_counts_all_that_is_known_of_it(cells: list[set[int]], steps: list[set[int]]) -> None:
    search = SearchRate(tuple(SearchCell(str(k), np.array(sorted(c))) for k, c in enumerate(cells)), SIZE)
    known: set[int] = set()
    times: list[float | None] = [None] * len(cells)
    for tick, changed in enumerate(steps):
        search.update(tick, np.array(sorted(changed), np.int64))
        known |= changed
        times = [tick / 10 if time is None and c <= known else time for time, c in zip(times, cells, strict=True)]
        assert search.rates == tuple(len(c & known) / len(c) for c in cells)
        assert search.search_time_s == times
        assert search.searched == all(c <= known for c in cells)


def test_a_cell_within_another_is_part_of_both() -> None:
    search = SearchRate((SearchCell("floor", np.arange(10)), SearchCell("room", np.arange(4, 6))), 10)
    search.update(7, np.arange(4, 6))
    assert search.rates == (0.2, 1.0)
    search.update(9, np.arange(10))
    assert search.rates == (1.0, 1.0)
    assert search.search_time_s == [0.9, 0.7]
