"""Shadowing that correlates over distance, against Gudmundson's formula."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from medium.shadowing import Shadowing

SIGMA_DB, D0_M = 6.0, 5.0
LINKS = list(itertools.combinations(range(80), 2))
HERE, THERE = np.array([30.0, 40.0]), np.array([50.0, 10.0])


shadowing_of = functools.cache(lambda seed: Shadowing(seed, SIGMA_DB, D0_M))


def shadows(a_m: NDArray[np.float64], b_m: NDArray[np.float64], seed: int = 3) -> NDArray[np.float64]:
    """X of all links, their first ends at one place and their second ends at another."""
    n = len(LINKS)
    drawn: NDArray[np.float64] = shadowing_of(seed).db(LINKS, np.tile(a_m, (n, 1)), np.tile(b_m, (n, 1)))
    return drawn


def test_it_is_normal() -> None:
    drawn = shadows(HERE, THERE)
    assert stats.kstest(drawn / SIGMA_DB, stats.norm.cdf).pvalue > 0.01
    assert np.abs(drawn).max() <= 4.0 * SIGMA_DB


@pytest.mark.parametrize("distance_m", [0.5, 2.0, 5.0, 12.0])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, -0.8)])
def test_it_correlates_as_the_exponential_of_the_way_of_an_end(
    distance_m: float, direction: tuple[float, float]
) -> None:
    way = distance_m * np.array(direction)
    before = shadows(HERE, THERE)
    expected = np.exp(-distance_m / D0_M)
    for after in (shadows(HERE + way, THERE), shadows(HERE, THERE + way)):
        assert np.corrcoef(before, after)[0, 1] == pytest.approx(expected, abs=0.04)
    both = shadows(HERE + way, THERE - way)
    assert np.corrcoef(before, both)[0, 1] == pytest.approx(expected**2, abs=0.04)


def test_it_is_a_function_of_seed_link_and_places() -> None:
    shadowing = Shadowing(3, SIGMA_DB, D0_M)
    places = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    all_three = shadowing.db([(1, 2), (1, 3), (2, 3)], places, places[::-1])
    alone = Shadowing(3, SIGMA_DB, D0_M).db([(2, 3)], places[2:], places[:1])
    assert alone[0] == all_three[2]
    assert shadowing.db([(1, 2)], places[:1], places[2:])[0] == all_three[0], "who comes back finds what it found"
    assert len(set(all_three.tolist())) == 3
    assert not np.array_equal(shadows(HERE, THERE, seed=4), shadows(HERE, THERE))
