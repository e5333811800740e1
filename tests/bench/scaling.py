"""How the cost of a tick in the cores grows: with the robots, their neighbors, the radius and the map.

One parameter changes at a time around a base. All runs are in one process, so only the cores are measured. The start,
when every robot scans for the first time, is left out. The last cases show the cost of cold caches, as of a process
after others have run.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from deploy.scenario import load
from deploy.simulation import Observer, Simulation
from tests.bench.mission import Degree

__all__ = ["Point", "scaling"]

_WARM_TICKS: Final = 10
_BASE: Final[dict[str, Any]] = {"robots": 30, "radius_m": 27.0}
_FEW: Final[dict[str, Any]] = {"robots": 9, "radius_m": 50.0}
_CASES: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("robots", _FEW),
    ("robots", {"robots": 30, "radius_m": 27.0}),
    ("robots", {"robots": 60, "radius_m": 19.0}),
    ("robots", {"robots": 100, "radius_m": 15.0}),
    ("radius and degree", {"radius_m": 15.0}),
    ("radius and degree", {"radius_m": 40.0}),
    ("radius and degree", {"radius_m": 80.0}),
    ("cells of the map", {"floor_plan.resolution_m": 1.0}),
    ("cells of the map", {"floor_plan.resolution_m": 0.5}),
    ("cells of the map", {"floor_plan.resolution_m": 0.25}),
)
_TOUCHED_MB: Final = (0, 2, 8, 32)
"""Memory that is touched between two ticks, to make the caches cold."""
_CACHE_LINE_BYTES: Final = 64


@dataclass(frozen=True)
class Point:
    """One case and its cost."""

    changed: str
    robots: int
    radius_m: float
    cells: int
    mean_degree: float
    cpu_ms_per_tick: float
    cpu_us_per_robot_tick: float


def scaling(ticks: int) -> Iterator[Point]:
    """Measure all cases over `ticks` ticks each."""
    for changed, values in _CASES:
        yield _point(changed, _BASE | values, ticks)
    for touched_mb in _TOUCHED_MB:
        yield _point(f"{touched_mb} MB used in between", _FEW, 10 * ticks, touched_mb)


def _point(changed: str, values: dict[str, Any], ticks: int, touched_mb: int = 0) -> Point:
    scenario = load("hundred", values)
    degree = Degree(scenario.radius_m)
    simulation = Simulation(scenario, Observer(snapshot=degree.add))
    others = np.zeros(touched_mb << 20, np.uint8)[::_CACHE_LINE_BYTES]
    for _ in range(_WARM_TICKS):
        simulation.step()
    spent_s = 0.0
    for _ in range(ticks):
        others += 1
        begun = time.process_time()
        simulation.step()
        spent_s += time.process_time() - begun
    cost_s = spent_s / ticks
    return Point(
        changed, scenario.robots, scenario.radius_m, scenario.arena.geometry.size, round(degree.mean, 1),
        round(cost_s * 1e3, 2), round(cost_s * 1e6 / scenario.robots, 1),
    )  # fmt: skip
