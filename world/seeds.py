"""Every random stream of a run, in one list: each is a function of the run's seed and of what it is for.

Nothing else in the packages makes a generator, so no two streams share their numbers, and who draws from one changes no
other (Salmon et al. 2011 for the counter-based ones).
"""

from __future__ import annotations

import hashlib
import random
from enum import IntEnum

import numpy as np

__all__ = ["Stream", "counted", "link_uniforms", "node_stream", "sequence"]


class Stream(IntEnum):
    """What numpy's generators are drawn for; incarnations of nodes and radio links have streams of their own below."""

    LIDAR = 0
    """Noise of a robot's ranges at a tick (`counted`)."""
    POSE = 1
    """Noise of a robot's pose at a tick (`counted`)."""
    CHOICE = 2
    """Whom a fault with target `random` hits (`sequence`)."""
    LOSS = 3
    """Which frames are lost, by the radio or by a fault (`sequence`)."""
    FADING = 4
    """Gains of all radio links at a tick (`counted`)."""
    BURSTS = 5
    """Which radio links turn bad or good at a tick (`counted`)."""
    SHADOWING = 6
    """Waves of a radio link's correlated shadowing (`counted`, by its two ends)."""
    STARTS = 100
    """Where robots start (`sequence`)."""
    VICTIMS = 101
    """Where victims are (`sequence`)."""


def sequence(seed: int, stream: Stream) -> np.random.Generator:
    """The generator of a stream that is drawn in the order of the run."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int(stream)])))


def counted(seed: int, stream: Stream, one: int, other: int) -> np.random.Generator:
    """The generator of one node and tick, or of two nodes: who else is there, and who was, changes nobody's numbers."""
    return np.random.Generator(np.random.Philox(counter=[0, 0, one, other], key=[seed, int(stream)]))


def node_stream(seed: int, node: int, incarnation: int) -> random.Random:
    """The generator of one incarnation of a node; a text seeds alike on every machine, under any PYTHONHASHSEED."""
    return random.Random(f"{seed}/{node}/{incarnation}")


def link_uniforms(seed: int, link: tuple[int, ...]) -> tuple[float, float]:
    """Two numbers in [0, 1) of a radio link between two places: a function of these, not of the order of visits."""
    digest = hashlib.blake2b(repr((seed, link)).encode(), digest_size=16).digest()
    return int.from_bytes(digest[:8], "little") / 2**64, int.from_bytes(digest[8:], "little") / 2**64
