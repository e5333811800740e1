"""How a link's power changes with time: fading and bursts, each a chain of states along the ticks, one for each link.

A chain's state in a tick is a function of the run's seed, the link and the tick: it does not matter who takes part,
nor who is looked at first. All chains of a run take a step in each tick.

*Fading.* Many reflections add up to a complex normal gain g with E|g|^2 = 1, whose autocorrelation falls as exp(-t /
coherence time) (a Gauss-Markov process, the AR(1) model). Without a line of sight the envelope |g| is Rayleigh
distributed. With one, K times as strong as the rest, it is Rician: the gain is (sqrt(K) + g) / sqrt(K + 1) (Rappaport,
Wireless Communications, 5.6).

*Bursts.* Interference comes and goes: each link is in a good or in a bad state, and changes with a fixed chance per
tick (Gilbert 1960, Elliott 1963). A burst lasts `burst_s` in the mean, and takes `burst_share` of the time.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from medium.config import Radio
from world.seeds import Stream, counted
from world.terms import TICK_S

T = TypeVar("T", bound=np.generic)
Ends: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Higher and lower node of each link."""

_LEAST_POWER: Final = 1e-12
"""Of a gain; its logarithm is a number."""


class Fading:
    """The gains of all links of a run."""

    def __init__(self, seed: int, robots: int, radio: Radio) -> None:
        self._seed = seed
        self._ends = _links(robots)
        self._shape = robots + 1, robots + 1
        self._kept = math.exp(-TICK_S / radio.coherence_s)
        self._renewed = math.sqrt(1.0 - self._kept * self._kept)
        rice = 10.0 ** (radio.rician_k_db / 10.0) if radio.fading == "rician" else 0.0
        self._direct = math.sqrt(rice / (rice + 1.0))
        self._scattered = math.sqrt(1.0 / (rice + 1.0))
        self._tick = -1
        self._gain = np.zeros((len(self._ends[0]), 2))
        """(links, 2) real and imaginary part of g."""

    def power_db(self, tick: int) -> NDArray[np.float64]:
        """(N + 1, N + 1) symmetric power gain of each link in a tick, by nodes; ticks must not fall."""
        while self._tick < tick:
            self._step()
        real = self._direct + self._scattered * self._gain[:, 0]
        imaginary = self._scattered * self._gain[:, 1]
        power = real * real + imaginary * imaginary
        return _both_ways(self._ends, self._shape, 10.0 * np.log10(np.maximum(power, _LEAST_POWER)))

    def _step(self) -> None:
        self._tick += 1
        drawn = counted(self._seed, Stream.FADING, 0, self._tick).standard_normal(self._gain.shape) * math.sqrt(0.5)
        self._gain = drawn if self._tick == 0 else self._kept * self._gain + self._renewed * drawn


class Bursts:
    """Which links of a run are in their bad state."""

    def __init__(self, seed: int, robots: int, radio: Radio) -> None:
        self._seed = seed
        self._ends = _links(robots)
        self._shape = robots + 1, robots + 1
        self._share = radio.burst_share
        self._end_chance = TICK_S / radio.burst_s
        self._begin_chance = self._end_chance * self._share / (1.0 - self._share)
        """So that as many bursts begin as end."""
        self._tick = -1
        self._bad = np.zeros(len(self._ends[0]), np.bool_)

    def bad(self, tick: int) -> NDArray[np.bool_]:
        """(N + 1, N + 1) symmetric: whether a link is bad in a tick, by nodes; ticks must not fall."""
        while self._tick < tick:
            self._step()
        return _both_ways(self._ends, self._shape, self._bad)

    def _step(self) -> None:
        self._tick += 1
        drawn = counted(self._seed, Stream.BURSTS, 0, self._tick).random(len(self._bad))
        if self._tick == 0:
            self._bad = drawn < self._share
        else:
            self._bad = np.where(self._bad, drawn >= self._end_chance, drawn < self._begin_chance)


def _links(robots: int) -> Ends:
    """Both ends of all links of nodes 0 to `robots`; more robots add links at the end."""
    higher, lower = np.tril_indices(robots + 1, -1)
    return higher, lower


def _both_ways(ends: Ends, shape: tuple[int, int], of_links: NDArray[T]) -> NDArray[T]:
    higher, lower = ends
    square = np.zeros(shape, of_links.dtype)
    square[higher, lower] = square[lower, higher] = of_links
    return square
