"""Configuration of the medium."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.terms import TICK_S, Positive, Probability

NEAREST_M: Final = 0.01
"""The curve of the received power has no value at distance 0: closer than this it is flat."""

Decibels = Annotated[float, Ge(-1000), Le(1000)]
Loss = Annotated[float, Ge(0), Le(1000)]
Model = Literal["disk", "disk_los", "log_distance"]
Fading = Literal["none", "rayleigh", "rician"]


@dataclass(frozen=True)
class Radio:
    """The propagation model and its values [paper 9.2, 9.3], at 2.4 GHz after ITU-R P.1238 and ns-3."""

    model: Model = "disk"
    tx_power_dbm: Decibels = 0.0
    loss_1m_db: Decibels = 40.0
    """PL0: path loss at one metre."""
    exponent: Annotated[float, Gt(0), Le(100)] = 3.0
    """n: the path loss grows by 10 n log10(d) dB up to distance d."""
    wall_loss_db: Loss = 18.0
    """Per wall crossed, `log_distance` only."""
    shadowing_db: Loss = 0.0
    """Standard deviation of X, normal and fixed per link and place, `log_distance` only."""
    shadowing_correlation_m: Annotated[float, Ge(0.1), Le(1e6)] | None = None
    """d0: X correlates as exp(-d / d0) over a way d of either end (Gudmundson 1991); None = constant in squares of 1 m.
    """
    fading: Fading = "none"
    """How power varies with time, `log_distance` only: rayleigh without a line of sight, rician with one."""
    coherence_s: Annotated[float, Ge(1e-3), Le(1e6)] = 1.0
    """A gain's correlation falls as exp(-t / coherence_s)."""
    rician_k_db: Annotated[float, Ge(-30), Le(60)] = 6.0
    """K: power of the line of sight over that of all reflections, `rician` only."""
    loss: Probability = 0.0
    """Probability that a receiver loses a frame."""
    burst_share: Annotated[float, Ge(0), Le(0.99)] = 0.0
    """Share of the time in which a link is in its bad state (Gilbert 1960, Elliott 1963); 0 = no bursts."""
    burst_s: Annotated[float, Ge(TICK_S), Le(1e6)] = 0.5
    """Mean length of a bad state."""
    burst_loss: Probability = 1.0
    """Probability that a receiver loses a frame of a link in its bad state."""
    bandwidth_bytes_s: Positive | None = None
    """Most that one node can send; None = unlimited. Frames beyond that are rejected."""
    channel_bytes_s: Positive | None = None
    """What nodes that hear one another share (medium/airtime.py); None = each has a channel of its own."""

    def check(self) -> None:
        """Check what concerns several fields.

        Raises:
            ValueError: one line that says what is wrong, with keys relative to `[radio]`.
        """
        if self.fading != "none" and self.model != "log_distance":
            raise ValueError(
                f'fading = "{self.fading}" needs model = "log_distance" (with wall_loss_db = 0 it reaches as far as '
                f'disk in the mean), not "{self.model}"'
            )
        least = TICK_S * self.burst_share / (1.0 - self.burst_share)
        if self.burst_s < least:
            raise ValueError(
                f"burst_s = {self.burst_s:g}: with burst_share = {self.burst_share:g} good states would be shorter "
                f"than a tick of {TICK_S:g} s; needs burst_s >= {least:.3g}"
            )

    @property
    def limited(self) -> bool:
        """Whether there is a limit to what a node can send."""
        return self.bandwidth_bytes_s is not None or self.channel_bytes_s is not None


@dataclass(frozen=True)
class MediumConfig:
    """One radio channel."""

    seed: int
    robots: int
    """N. With `cells` it says which answers are possible."""
    cells: int
    """Number of search cells, on which the station reports."""
    radius_m: float
    """r_t: the range of `disk` and `disk_los`; for `log_distance` the mean power meets the sensitivity here."""
    geometry: GridGeometry
    occupied: NDArray[np.bool_]
    """(rows, cols) walls; only `disk_los` and `log_distance` look at them."""
    radio: Radio = field(default_factory=Radio)
    """At the start."""
    changes: tuple[tuple[int, Radio], ...] = ()
    """(tick, the radio from that tick on), ascending by tick."""
