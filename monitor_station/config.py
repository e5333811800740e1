"""The configs of the monitor station and of the recorder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.config import RobotConfig
from world.grid import GridGeometry

JOURNAL: Final = "journal"
MAP: Final = "map.yaml"
"""Files of the station in the run folder."""
FINISHED: Final = 0.995
"""A search is finished when so much of what is free and can be reached is known to be free."""


def cell_title(name: str) -> str:
    """Name of a search cell for people: where the scenario only numbers cells, it does not read as a robot's."""
    return f"Cell {name}" if name.isdigit() else name


@dataclass(frozen=True)
class SearchCell:
    """A space whose search is measured [paper 7.1, 8.1]."""

    name: str
    cells: NDArray[np.int64]
    """Flat grid indices of its free area."""


@dataclass(frozen=True)
class StationConfig:
    """The MS: its node (rules of motion are unused) and the search cells that it measures."""

    node: RobotConfig
    search_cells: tuple[SearchCell, ...]
    occupied: NDArray[np.bool_]
    """(rows, cols) true floor plan, for the measures only, as the search cells are."""

    @property
    def enough(self) -> float:
        """Share of a search cell that must be known to be free: all of it, or what noisy sensors can tell."""
        return FINISHED if self.node.lidar_noise_m > 0 or self.node.pose_noise_m > 0 else 1.0


@dataclass(frozen=True)
class RecorderConfig:
    """What a recording shows besides the data of the run: floor plan, victims, names."""

    run: str
    geometry: GridGeometry
    occupied: NDArray[np.bool_]
    station_m: tuple[float, float]
    radius_m: float
    robots: int
    victims_m: NDArray[np.float64]
    search_cells: tuple[SearchCell, ...]
    cell_rectangles_m: tuple[tuple[float, float, float, float], ...]
    """x0, y0, x1, y1 of each search cell, for its label."""
    recording_id: str = ""
    """Equal in all files of one run's recording, so that a viewer joins them; empty: a random one."""
