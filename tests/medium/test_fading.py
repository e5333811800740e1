"""Fading and bursts against their closed formulas, and independence of who is there and who asks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from medium.config import Radio
from medium.fading import Bursts, Fading
from world.terms import TICK_S

ROBOTS = 60
LINKS = np.tril_indices(ROBOTS + 1, -1)
COHERENCE_S = 0.5


def powers(radio: Radio, ticks: int) -> NDArray[np.float64]:
    """(ticks, links) power gains, linear."""
    fading = Fading(3, ROBOTS, radio)
    return np.array([10.0 ** (fading.power_db(tick)[LINKS] / 10.0) for tick in range(ticks)])


@pytest.mark.parametrize("tick", [0, 7])
def test_the_power_of_rayleigh_fading_is_exponential(tick: int) -> None:
    drawn = powers(Radio("log_distance", fading="rayleigh", coherence_s=COHERENCE_S), tick + 1)[tick]
    assert stats.kstest(drawn, stats.expon.cdf).pvalue > 0.01


@pytest.mark.parametrize("k_db", [3.0, 9.0])
def test_the_power_of_rician_fading_is_noncentral_chi_square(k_db: float) -> None:
    k = 10.0 ** (k_db / 10.0)
    drawn = powers(Radio("log_distance", fading="rician", rician_k_db=k_db, coherence_s=COHERENCE_S), 8)[7]
    assert stats.kstest(2.0 * (k + 1.0) * drawn, stats.ncx2(2, 2.0 * k).cdf).pvalue > 0.01
    assert stats.kstest(drawn, stats.expon.cdf).pvalue < 1e-6, "it is not Rayleigh"


def test_power_correlates_in_time_as_the_coherence_time_says() -> None:
    """Of a complex normal gain with correlation r, powers correlate by r^2 (Siegert's relation)."""
    drawn = powers(Radio("log_distance", fading="rayleigh", coherence_s=COHERENCE_S), 120) - 1.0
    for lag in (1, 2, 5, 10):
        measured = float((drawn[lag:] * drawn[:-lag]).mean() / (drawn * drawn).mean())
        assert measured == pytest.approx(np.exp(-2.0 * lag * TICK_S / COHERENCE_S), abs=0.02)


def test_links_fade_apart_from_one_another() -> None:
    gains = Fading(3, ROBOTS, Radio("log_distance", fading="rayleigh")).power_db(0)
    assert np.array_equal(gains, gains.T)
    assert len(np.unique(gains[LINKS])) == len(LINKS[0])


@pytest.mark.parametrize("kind", [Fading, Bursts])
def test_a_state_is_a_function_of_seed_link_and_tick(kind: type[Fading | Bursts]) -> None:
    radio = Radio("log_distance", fading="rayleigh", burst_share=0.4)

    def state(chains: Fading | Bursts, tick: int) -> NDArray[np.generic]:
        return chains.power_db(tick) if isinstance(chains, Fading) else chains.bad(tick)

    every, some, few = kind(3, 12, radio), kind(3, 12, radio), kind(3, 5, radio)
    for tick in range(9):
        at_tick = state(every, tick)
    assert np.array_equal(state(some, 8), at_tick), "whoever looked before"
    assert np.array_equal(state(few, 8), at_tick[:6, :6]), "however many others there are"
    assert not np.array_equal(state(kind(4, 12, radio), 8), at_tick)


@pytest.mark.parametrize(("share", "burst_s"), [(0.2, 0.5), (0.5, 2.0), (0.05, 0.1)])
def test_bursts_take_their_share_and_last_as_long_as_they_should(share: float, burst_s: float) -> None:
    bursts = Bursts(3, ROBOTS, Radio(burst_share=share, burst_s=burst_s))
    bad = np.array([bursts.bad(tick)[LINKS] for tick in range(400)])
    assert bad[0].mean() == pytest.approx(share, abs=0.03), "stationary from the first tick on"
    assert bad.mean() == pytest.approx(share, rel=0.03)
    mean = burst_s / TICK_S
    goes_on = bad[1:]
    assert (~goes_on[bad[:-1]]).mean() == pytest.approx(1.0 / mean, rel=0.05)
    old = bad[1:-1] & bad[:-2]
    assert old.any() == (mean > 1.0)
    if mean > 1.0:
        assert (~bad[2:][old]).mean() == pytest.approx(1.0 / mean, rel=0.05), "whatever its age: lengths are geometric"
