"""Configuration of the medium."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.terms import Positive, Probability

Decibels = Annotated[float, Ge(-1000), Le(1000)]
Loss = Annotated[float, Ge(0), Le(1000)]
Model = Literal["disk", "disk_los", "log_distance"]


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
    loss: Probability = 0.0
    """Probability that a receiver loses a frame."""
    bandwidth_bytes_s: Positive | None = None
    """Most that one node can send; None = unlimited. Frames beyond that are rejected."""


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
