"""What fine maps cost: a floor of 80 x 80 m under a lidar of 25 m, at 0.25 and 0.05 m, or a map of the user's.

All in one process. Processor time of the world's scans, and by robot and tick of the phases `mapping` (a scan into the
own map, and what came from the MS) and `planning`. The start, when every robot scans for the first time, is left out.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from deploy.scenario import load
from deploy.simulation import Simulation
from world.lidar import Caster

__all__ = ["Cost", "fine_maps"]

_WARM_TICKS: Final = 10
_RESOLUTIONS_M: Final = 0.25, 0.05
_POLICIES: Final = "scout", "sortie"
_FLOOR: Final[dict[str, Any]] = {"robots": 12, "radius_m": 25.0, "lidar.range_m": 25.0, "lidar.beams": 720}
_MAP: Final[dict[str, Any]] = {"robots": 12, "radius_m": 15.0, "radio.model": "disk_los", "body_radius_m": 0.0}


@dataclass(frozen=True)
class Cost:
    """One map, resolution and policy, and its cost."""

    policy: str
    resolution_m: float
    cells: int
    cpu_ms_per_tick: float
    world_scan_ms: float
    mapping_p99_ms: float
    mapping_max_ms: float
    planning_p99_ms: float
    planning_max_ms: float


def fine_maps(ticks: int, map_file: Path | None) -> Iterator[Cost]:
    """Measure all cases over `ticks` ticks each."""
    with tempfile.TemporaryDirectory(prefix="vds-bench-") as folder:
        scenario, values = str(map_file), _MAP
        if map_file is None:
            floor = Path(folder) / "halls.toml"
            floor.write_text(_halls())
            scenario, values = str(floor), _FLOOR
        for resolution_m, policy in itertools.product(_RESOLUTIONS_M, _POLICIES):
            chosen = {"seed": 1, "policy": policy, "floor_plan.resolution_m": resolution_m}
            yield _cost(scenario, values | chosen, ticks)


def _halls() -> str:
    """A hall of 40 x 40 m, and rooms of 10 x 10 m around it with doors between all neighbors."""
    free = [[0.25, 0.25, 39.75, 39.75]]
    for i, j in itertools.product(range(8), range(8)):
        x, y = 10.0 * i, 10.0 * j
        free += [[x + 0.25, y + 0.25, x + 9.75, y + 9.75]] if max(i, j) >= 4 else []
        free += [[x + 9.75, y + 3.0, x + 10.25, y + 4.5]] if i < 7 else []
        free += [[x + 6.0, y + 9.75, x + 7.5, y + 10.25]] if j < 7 else []
    return f"name = 'halls'\n[floor_plan]\nsize_m = [80.0, 80.0]\nfree = {free}\n[station]\nposition_m = [20.0, 20.0]\n"


class _Clock:
    """Processor time of each phase, of each robot and tick."""

    def __init__(self) -> None:
        self.spent_ms: dict[str, list[float]] = {}
        self._last_s = 0.0

    def mark(self, phase: str) -> None:
        now_s = time.process_time()
        self.spent_ms.setdefault(phase, []).append(1e3 * (now_s - self._last_s))
        self._last_s = now_s


def _cost(name: str, values: dict[str, Any], ticks: int) -> Cost:
    scenario = load(name, values)
    simulation, clock = Simulation(scenario), _Clock()
    for _ in range(_WARM_TICKS):
        simulation.step()
    for robot in simulation.robots.values():
        robot.mark = clock.mark
    begun_s = time.process_time()
    for _ in range(ticks):
        simulation.step()
    spent_s = time.process_time() - begun_s
    arena, lidar = scenario.arena, scenario.tables.lidar
    caster = Caster(arena.occupied, arena.geometry, lidar.beams, lidar.range_m)
    begun_s = time.process_time()
    for robot in simulation.robots.values():
        caster.cast(*robot.body.at)
    scan_s = (time.process_time() - begun_s) / len(simulation.robots)
    mapping, planning = (np.percentile(clock.spent_ms[phase], (99, 100)).round(2) for phase in ("mapping", "planning"))
    return Cost(
        scenario.tables.policy, arena.geometry.resolution_m, arena.geometry.size,
        round(1e3 * spent_s / ticks, 2), round(1e3 * scan_s, 3), *mapping.tolist(), *planning.tolist(),
    )  # fmt: skip
