"""Shadowing: how much a link's mean power lies above or below the curve, by where its ends are.

X is normal, cut off at `MOST_SIGMAS`, and a function of the run's seed, the link and both places: a robot that comes
back finds what it found. By default it is constant while both ends stay in squares of a metre. With a correlation
distance d0 it changes smoothly: when one end moves by d, the correlation is exp(-d / d0) (Gudmundson 1991), and the
factors of both ends multiply. It is made of plane waves (Cai & Giannakis 2003). Their wavenumbers k have the density
whose transform in the plane is that exponential: 1 - 1 / sqrt(1 + (k d0)^2) of them are below k.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from world.seeds import Stream, counted, link_uniforms

MOST_SIGMAS: Final = 4.0
_PLACE_M: Final = 1.0
_WAVES: Final = 32
"""The kurtosis of their sum is 3 - 1.5 / 32."""


class Shadowing:
    """X of all links of a run."""

    def __init__(self, seed: int, sigma_db: float, correlation_m: float | None) -> None:
        """`correlation_m`: d0, or None for squares."""
        self._seed = seed
        self._sigma_db = sigma_db
        self._correlation_m = correlation_m
        self._of_squares = lru_cache(maxsize=100_000)(self._draw_of_squares)
        self._waves = lru_cache(maxsize=100_000)(self._draw_waves)

    def db(
        self, links: Sequence[tuple[int, int]], a_m: NDArray[np.float64], b_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(n,) X of links.

        Args:
            links: both ends of each, the lower id first.
            a_m: (n, 2) places of the first ends.
            b_m: (n, 2) places of the second ends.
        """
        if not links:
            return np.zeros(0)
        if self._correlation_m is None:
            squares = np.floor(np.concatenate((a_m, b_m), axis=1) / _PLACE_M).astype(int).tolist()
            normal = np.array([self._of_squares(*link, *square) for link, square in zip(links, squares, strict=True)])
        else:
            waves = np.stack([self._waves(*link) for link in links], axis=-1)
            phase = waves[0] * a_m[:, 0] + waves[1] * a_m[:, 1] + waves[2] * b_m[:, 0] + waves[3] * b_m[:, 1] + waves[4]
            # One after the other: `sum` adds in another order where there is only one link.
            normal = math.sqrt(2.0 / _WAVES) * np.cos(phase).cumsum(axis=0)[-1]
        cut: NDArray[np.float64] = self._sigma_db * np.clip(normal, -MOST_SIGMAS, MOST_SIGMAS)
        return cut

    def _draw_of_squares(self, *link: int) -> float:
        """A standard normal number. It is a hash, so that it does not depend on the order of visits."""
        u, v = link_uniforms(self._seed, link)
        return math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v)

    def _draw_waves(self, lower: int, higher: int) -> NDArray[np.float64]:
        """(5, waves): x and y of the wave vector for one end, the same for the other one, and the phase."""
        assert self._correlation_m is not None
        drawn = counted(self._seed, Stream.SHADOWING, lower, higher).random((5, _WAVES))
        waves = np.empty((5, _WAVES))
        for end in (0, 2):
            length = np.sqrt(1.0 / (1.0 - drawn[end]) ** 2 - 1.0) / self._correlation_m
            angle = 2.0 * math.pi * drawn[end + 1]
            waves[end], waves[end + 1] = length * np.cos(angle), length * np.sin(angle)
        waves[4] = 2.0 * math.pi * drawn[4]
        return waves
