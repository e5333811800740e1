"""Airtime: how many bytes each node may send in a tick, by its own bandwidth and by its share of the channel.

Bytes that a node leaves unsent are added to its next ticks, `SAVED_TICKS` ticks' worth at most. So a frame longer than
a tick's share leaves after as many ticks as it takes to send (a token bucket: Tanenbaum & Wetherall, Computer
Networks, 5.4).

Where nodes share one channel, a node and those that it hears are its sharers: while one of them sends, the others
can't. A node gets the channel's bytes over the most sharers that itself or a node in its hearing has. So no node hears
more than the channel carries, for each of its m sharers, itself among them, gets an m-th at most. What a sharer leaves
unsent goes to nobody else.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from medium.config import Radio
from medium.messages import UNLIMITED
from world.terms import TICK_S

SAVED_TICKS: Final = 5
"""Most ticks whose bytes a node can have left for one tick."""


class Airtime:
    """What each node may still send."""

    def __init__(self, radio: Radio) -> None:
        self.tune(radio)
        self._left: dict[int, float] = {}
        """By node: bytes that it may send. A node that never heard how many those are has none."""
        self._share: dict[int, float] = {}

    def tune(self, radio: Radio) -> None:
        """Let each tick add what this radio has, from the next `refill` on."""
        self.limited = radio.limited
        self._own_bytes = UNLIMITED if radio.bandwidth_bytes_s is None else radio.bandwidth_bytes_s * TICK_S
        self._channel_bytes = None if radio.channel_bytes_s is None else radio.channel_bytes_s * TICK_S

    def told(self, node: int) -> tuple[int, int]:
        """Whole bytes that a node may send in the coming tick, and how many each tick adds."""
        if not self.limited:
            return UNLIMITED, UNLIMITED
        return int(min(self._left[node], UNLIMITED)), int(min(self._share[node], UNLIMITED))

    def spend(self, node: int, size: int) -> bool:
        """Whether a frame of that size may leave now; if so, its bytes are used up."""
        if not self.limited:
            return True
        left = self._left.get(node, 0.0) - size
        if left < 0.0:
            return False
        self._left[node] = left
        return True

    def refill(self, nodes: list[int], heard: NDArray[np.bool_]) -> None:
        """Add a tick's share to what each node has left.

        Args:
            nodes: who takes part.
            heard: (n, n) which of them hears which.
        """
        if not self.limited:
            return
        for node, share in zip(nodes, self._shares(heard), strict=True):
            self._share[node] = share
            self._left[node] = min(self._left.get(node, 0.0) + share, SAVED_TICKS * share)

    def _shares(self, heard: NDArray[np.bool_]) -> list[float]:
        if self._channel_bytes is None:
            return [self._own_bytes] * len(heard)
        sharers = heard.sum(axis=1) + 1
        most = np.maximum(sharers, np.where(heard, sharers, 0).max(axis=1, initial=0))
        shares: list[float] = np.minimum(self._own_bytes, self._channel_bytes / most).tolist()
        return shares
