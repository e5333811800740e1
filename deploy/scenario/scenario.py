"""A checked scenario, and the configs that follow from it for the processes of a run."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from agents.config import POWER_SMOOTHING_S, RobotConfig
from bus.excerpt import shown
from deploy.scenario.arena import Arena
from deploy.scenario.changes import radio_changes
from deploy.scenario.tables import Tables
from medium.config import MediumConfig
from monitor_station.config import RecorderConfig, StationConfig
from world.config import WorldConfig
from world.faults import fault_form
from world.grid.map_file import digest_of_map
from world.terms import STATION

__all__ = ["Scenario"]


@dataclass(frozen=True)
class Scenario:
    """A checked scenario: its tables, and the arena that they describe."""

    tables: Tables
    arena: Arena

    @property
    def name(self) -> str:
        return self.tables.name

    @property
    def robots(self) -> int:
        return self.tables.robots

    @property
    def seed(self) -> int:
        return self.tables.seed

    @property
    def radius_m(self) -> float:
        return self.tables.radius_m

    @property
    def duration_s(self) -> float:
        return self.tables.duration_s

    @property
    def cell_names(self) -> tuple[str, ...]:
        return tuple(cell.name for cell in self.arena.search_cells)

    @property
    def speed(self) -> float:
        """Simulated seconds per wall second; 0 = as fast as possible."""
        return 0.0 if self.tables.speed == "max" else self.tables.speed

    @property
    def external(self) -> tuple[int, ...]:
        """Robots whose processes are none of the launcher's, ascending."""
        return tuple(robot.id for robot in self.tables.robot if robot.external)

    @property
    def not_in_process(self) -> str:
        """One line on why the run can't be in one process; empty if it can."""
        if not self.external:
            return ""
        return f"robot {self.external[0]} is external: a process of its own, so the run can't be in one process"

    @property
    def remark(self) -> str:
        """One line, shown before the run, on the floor that can't be reached; empty if all of it can."""
        arena = self.arena
        if not arena.unreachable:
            return ""
        cells = zip(self.cell_names, arena.unreachable_of, strict=True)
        cut = [f"{_percent(share)} of cell '{shown(name)}'" for name, share in cells if share]
        return (
            ", ".join([f"{_percent(arena.unreachable)} of the free floor", *cut]) + " can't be reached from the station"
        )

    def world_config(self) -> WorldConfig:
        tables, arena, moving = self.tables, self.arena, self.tables.rules.moving
        return WorldConfig(
            seed=tables.seed,
            robots=tables.robots,
            geometry=arena.geometry,
            occupied=arena.occupied,
            station_m=arena.station_m,
            starts_m=arena.starts_m,
            top_speed_m_s=max(moving.speed_m_s, moving.trace_speed_m_s),
            duration_s=tables.duration_s,
            victims_m=arena.victims_m,
            lidar=tables.lidar,
            pose_noise_m=tables.pose_noise_m,
            body_radius_m=tables.body_radius_m,
            faults=tables.fault,
            external=self.external,
            cell_names=self.cell_names,
            hang_deadline_s=tables.deadlines.hang_s,
            think_deadline_s=tables.deadlines.think_s,
            medium_deadline_s=tables.deadlines.medium_s,
            return_deadline_s=tables.deadlines.return_s,
            speed=self.speed,
        )

    def medium_config(self) -> MediumConfig:
        tables, arena = self.tables, self.arena
        return MediumConfig(
            seed=tables.seed,
            robots=tables.robots,
            cells=len(self.cell_names),
            radius_m=tables.radius_m,
            geometry=arena.geometry,
            occupied=arena.occupied,
            radio=tables.radio,
            changes=radio_changes(tables),
        )

    def robot_config(self, node: int) -> RobotConfig:
        """What robot `node` knows before it starts; `station_config` has the station."""
        tables, arena, radio = self.tables, self.arena, self.tables.radio
        noisy = radio.model == "log_distance" and (radio.shadowing_db > 0 or radio.fading != "none")
        return RobotConfig(
            node=node,
            seed=tables.seed,
            geometry=arena.geometry,
            station_m=arena.station_m,
            safety_zone_m=arena.safety_zone_m,
            radius_m=tables.radius_m,
            lidar_range_m=tables.lidar.range_m,
            lidar_beams=tables.lidar.beams,
            tx_power_dbm=radio.tx_power_dbm,
            loss_1m_db=radio.loss_1m_db,
            exponent=radio.exponent,
            robots=tables.robots,
            lidar_noise_m=tables.lidar.noise_m,
            pose_noise_m=tables.pose_noise_m,
            power_smoothing_s=POWER_SMOOTHING_S if noisy else 0.0,
            wall_factor=tables.rules.scouting.wall_factor(radio.model, radio.wall_loss_db, radio.exponent),
            body_radius_m=tables.body_radius_m,
            bandwidth_limited=radio.limited,
            policy=tables.policy,
            rules=tables.rules,
        )

    def station_config(self) -> StationConfig:
        return StationConfig(self.robot_config(STATION), self.arena.search_cells, self.arena.occupied)

    def recorder_config(self, run: str) -> RecorderConfig:
        tables, arena = self.tables, self.arena
        return RecorderConfig(
            run=run,
            geometry=arena.geometry,
            occupied=arena.occupied,
            station_m=arena.station_m,
            radius_m=tables.radius_m,
            robots=tables.robots,
            victims_m=arena.victims_m,
            search_cells=arena.search_cells,
            cell_rectangles_m=arena.cell_rectangles_m,
        )

    def to_toml(self) -> str:
        """The scenario as resolved, every default written out: `load` of it gives the same run."""
        raw = _plain(dataclasses.asdict(self.tables))
        raw["fault"] = [fault_form(fault) for fault in self.tables.fault]
        if self.tables.floor_plan.map is not None:
            raw["floor_plan"]["map_sha256"] = digest_of_map(Path(self.tables.floor_plan.map))
        text: str = tomli_w.dumps({key: value for key, value in raw.items() if value != []})
        return text


def _percent(share: float) -> str:
    return f"{share:.1%}" if share >= 0.001 else "less than 0.1%"


def _plain(value: Any) -> Any:
    """The value in types of TOML: tuples become lists; keys whose value is None are left out."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
