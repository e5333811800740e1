"""Configuration of a world process. Bounds are `annotated_types`; scenarios are checked against them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.terms import MOST, NotNegative, Positive, Probability

Verb = Literal["kill", "restart", "pause", "jam", "loss"]


@dataclass(frozen=True)
class Lidar:
    """A lidar that scans all around [paper 7.3]."""

    range_m: Positive = 8.0
    beams: Annotated[int, Ge(8), Le(3600)] = 180
    interval_ticks: Annotated[int, Ge(1), Le(MOST)] = 5
    """A robot scans at its first tick and whenever (tick + node) is a multiple of this."""
    noise_m: NotNegative = 0.0
    """Standard deviation of a range."""


@dataclass(frozen=True)
class Fault:
    """A fault and when it acts, by schedule or by hand; docs/faults.md has the verbs and the targets."""

    verb: Verb
    at_s: NotNegative
    target: str = ""
    """A robot id, `station`, relay:mid, relay:first, nms-of:7, sr:far, random;
    for jam: a,b (pair) or x0,y0,x1,y1 (region)."""
    for_s: NotNegative | None = None
    """Duration; None for kill."""
    probability: Probability = 0.0
    """That a receiver loses a frame; `loss` only."""


@dataclass(frozen=True)
class WorldConfig:
    """Ground truth of one run."""

    seed: int
    robots: int
    geometry: GridGeometry
    occupied: NDArray[np.bool_]
    """(rows, cols) true floor plan: True = wall."""
    station_m: tuple[float, float]
    starts_m: NDArray[np.float64]
    """(robots, 2) positions of robots 1..N at tick 0."""
    top_speed_m_s: float
    """The world caps a robot's velocity at this."""
    duration_s: float
    """The run ends here with `time_limit`."""
    victims_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    """(v, 2) positions of victims; the id is the row."""
    lidar: Lidar = field(default_factory=Lidar)
    pose_noise_m: float = 0.0
    body_radius_m: float = 0.0
    """Robots are discs of this radius that do not pass through one another (world/bodies.py); 0 = points that do."""
    faults: tuple[Fault, ...] = ()
    external: tuple[int, ...] = ()
    """Robots, ascending, whose processes others start and end: no fault can kill, pause or restart them."""
    cell_names: tuple[str, ...] = ()
    """Names of the search cells, in the order of the station's search rates; for events only."""
    hang_deadline_s: float = 2.0
    """Wall time after which a node that neither answers nor works is departed as unresponsive (world/silence.py)."""
    think_deadline_s: float = 60.0
    """Processor time that a node's process may spend on one tick; after more it is departed although it works."""
    medium_deadline_s: float = 30.0
    """Wall time after which a silent medium ends the run as failed."""
    return_deadline_s: float = 30.0
    """Wall time in which processes must come at the start and at scheduled returns."""
    speed: float = 0.0
    """Simulated seconds per wall second; 0 = as fast as possible."""
    held: bool = False
    """No tick begins before the operator says `step` or `speed`."""
