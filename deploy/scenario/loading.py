"""A scenario: one file that says everything about a run, checked before anything starts."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import tomli_w

from agents.config import RobotConfig
from agents.policies import PolicyError, policy_class
from deploy.scenario.arena import Arena, survey
from deploy.scenario.tables import ScenarioError, Tables, nearest, validate
from medium.config import MediumConfig, Radio
from monitor_station.config import RecorderConfig, StationConfig
from world.config import Fault, WorldConfig
from world.faults import check_fault, fault_form, parse_fault
from world.map_file import digest_of_map
from world.terms import STATION

__all__ = ["Scenario", "load", "names", "parse_set"]

FOLDER: Final = Path(__file__).resolve().parent.parent / "scenarios"
_SMOOTHING_S: Final = 1.0
_BARE: Final = re.compile(r"[A-Za-z_][\w:.-]*")


@dataclass(frozen=True)
class Scenario:
    """A scenario that fits together: its tables, and the arena that they stand for."""

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
            faults=tables.fault,
            cell_names=self.cell_names,
            hang_deadline_s=tables.deadlines.hang_s,
            medium_deadline_s=tables.deadlines.medium_s,
            return_deadline_s=tables.deadlines.return_s,
            speed=self.speed,
        )

    def medium_config(self) -> MediumConfig:
        tables, arena = self.tables, self.arena
        return MediumConfig(tables.seed, tables.radius_m, arena.geometry, arena.occupied, tables.radio)

    def robot_config(self, node: int) -> RobotConfig:
        """What robot `node` knows before it starts; for the station's own node see `station_config`."""
        tables, arena, radio = self.tables, self.arena, self.tables.radio
        noisy = radio.model == "log_distance" and radio.shadowing_db > 0
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
            power_smoothing_s=_SMOOTHING_S if noisy else 0.0,
            wall_factor=_wall_factor(radio, tables.rules.scouting.wall_loss_db),
            policy=tables.policy,
            rules=tables.rules,
        )

    def station_config(self) -> StationConfig:
        return StationConfig(self.robot_config(STATION), self.arena.search_cells)

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


def load(source: str | Path, overrides: Mapping[str, Any] | None = None, *, own_faults: bool = True) -> Scenario:
    """Load a scenario and check all of it.

    Args:
        source: name of a scenario in deploy/scenarios, path of a .toml file, or path of a ROS map's .yaml file.
        overrides: values by dotted key, such as {"radio.loss": 0.1}, put in before anything is checked. Those of
            "fault", a list of tables or of texts as the command line has them, are added to the scenario's own.
        own_faults: False leaves out the faults that the source itself has.

    Raises:
        ScenarioError: with one line that names the file, the key, and what would be right.
    """
    raw, path = _read(str(source))
    if not own_faults:
        raw.pop("fault", None)
    try:
        for key, value in (overrides or {}).items():
            _put(raw, key, value)
        plan = raw.get("floor_plan")
        if isinstance(plan, dict) and isinstance(plan.get("map"), str):
            plan["map"] = str((path.parent / plan["map"]).resolve())
        _apply_policy(raw)
        tables = validate(raw)
        _check(tables)
        return Scenario(tables, survey(tables))
    except ScenarioError as error:
        raise ScenarioError(f"{source}: {error}") from None


def _apply_policy(raw: dict[str, Any]) -> None:
    """Check the policy's name, and let its own defaults stand wherever the scenario says nothing.

    Raises:
        ScenarioError: there is no such policy.
    """
    name = raw.get("policy", "vds")
    if not isinstance(name, str):
        return
    try:
        defaults = policy_class(name).DEFAULTS
    except PolicyError as error:
        raise ScenarioError(f"policy = '{name}': {error}") from None
    for key, value in defaults.items():
        *tables, last = key.split(".")
        place: Any = raw
        for table in tables:
            place = place.setdefault(table, {}) if isinstance(place, dict) else None
        if isinstance(place, dict):
            place.setdefault(last, value)


def names() -> list[str]:
    """The scenarios that come with the emulator."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def parse_set(text: str) -> tuple[str, Any]:
    """Read KEY=VALUE, such as radio.loss=0.1; VALUE as in TOML, or a bare word as text.

    Raises:
        ScenarioError: it is not of that form.
    """
    key, equals, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not equals or not key or not value:
        raise ScenarioError(f"'{text}': expected KEY=VALUE, such as radio.loss=0.1")
    try:
        parsed = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        if not _BARE.fullmatch(value):
            raise ScenarioError(
                f"'{text}': '{value}' is not a TOML value, such as 0.1, true, \"text\" or [1, 2]"
            ) from None
        return key, value
    if list(parsed) != ["value"]:
        raise ScenarioError(f"'{text}': more than one value")
    return key, parsed["value"]


def _read(source: str) -> tuple[dict[str, Any], Path]:
    """The raw tables of a source, and the path that its relative paths are relative to."""
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        return {"name": path.stem, "floor_plan": {"map": path.name}}, path
    if path.suffix != ".toml":
        if source not in names():
            hint = nearest(source, names())
            raise ScenarioError(f"unknown scenario '{source}', {hint} (or give the path of a .toml or a map's .yaml)")
        path = FOLDER / f"{source}.toml"
    try:
        return copy.deepcopy(_parsed(path.read_text("utf-8"))), path
    except OSError as error:
        raise ScenarioError(f"{source}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{source}: not TOML: {error}") from None


@functools.lru_cache(maxsize=16)
def _parsed(text: str) -> dict[str, Any]:
    return tomllib.loads(text)


def _put(raw: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    place: Any = raw
    for i, table in enumerate(tables):
        place = place.setdefault(table, {})
        if not isinstance(place, dict):
            raise ScenarioError(f"cannot set '{key}', since '{'.'.join(tables[: i + 1])}' is no table of single keys")
    if key == "fault" and isinstance(value, list | tuple):
        own = place.get(last, [])
        value = [*(own if isinstance(own, list) else []), *map(_fault_table, value)]
    if key == "speed" and isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    place[last] = value


def _fault_table(fault: Any) -> Any:
    """A fault as a scenario's [[fault]] has it, whichever way it was given."""
    try:
        if isinstance(fault, str):
            fault = parse_fault(fault)
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    return fault_form(fault) if isinstance(fault, Fault) else fault


def _check(tables: Tables) -> None:
    """What no field can say alone."""
    routing, retreat = tables.rules.routing, tables.rules.exploring
    if not routing.r_in_share < routing.r_out_share <= 1:
        shares = f"r_in_share = {routing.r_in_share:g}, r_out_share = {routing.r_out_share:g}"
        raise ScenarioError(f"rules.routing: {shares}: needs r_in_share < r_out_share <= 1")
    if retreat.retreat_min_s > retreat.retreat_max_s:
        raise ScenarioError("rules.exploring: needs retreat_min_s <= retreat_max_s")
    for i, fault in enumerate(tables.fault, 1):
        try:
            check_fault(fault, tables.robots, tables.duration_s)
        except ValueError as error:
            raise ScenarioError(f"fault[{i}]: {error}") from None


def _wall_factor(radio: Radio, believed_db: float | None) -> float:
    """How many times farther away one wall makes a node seem, as the robots believe."""
    if radio.model == "disk":
        return 1.0
    if radio.model == "disk_los":
        return math.inf
    loss_db = radio.wall_loss_db if believed_db is None else believed_db
    factor: float = 10.0 ** (loss_db / (10.0 * radio.exponent))
    return factor


def _plain(value: Any) -> Any:
    """TOML types: lists for tuples, and nothing for None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
