"""What the operators know at a tick: the output of the station's core for the recorder. All of it came by radio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class StationView:
    """Columns follow `robots`, the robots that the MS's forwarding table knows."""

    tick: int
    robots: NDArray[np.int16]
    xy_m: NDArray[np.float32]
    """(n, 2) as last heard."""
    cls: NDArray[np.uint8]
    reachable: NDArray[np.bool_]
    """The MS has a finite route to it."""
    cells: NDArray[np.int64]
    """Flat indices of map cells whose state changed in this tick, perhaps one twice."""
    values: NDArray[np.int8]
    """Their states now: world.grid.FREE, OCCUPIED or UNKNOWN."""
    victims: tuple[tuple[int, float, float], ...]
    """Victims reported so far: (id, x, y)."""
    search_rate: tuple[float, ...]
