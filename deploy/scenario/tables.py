"""The tables of a scenario file, and the one-line errors of a file that does not fit them.

A table that concerns one process *is* the config dataclass of that process. So `[lidar]`, `[radio]`, `[rules]` and
`[[fault]]` are checked against the bounds beside the fields of their owners.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import ConfigDict, TypeAdapter, ValidationError

from agents.config import Rules
from bus.excerpt import shown
from medium.config import NEAREST_M, Radio
from world.config import Fault, Lidar
from world.grid.geometry import MAX_CELLS
from world.terms import MOST, NotNegative, Positive

__all__ = [
    "TABLES",
    "Cell",
    "Change",
    "Deadlines",
    "FloorPlan",
    "Robot",
    "ScenarioError",
    "StationPlace",
    "Tables",
    "Victims",
    "checked",
    "dataclass_in",
    "nearest",
    "validate",
    "validate_fault",
]

Coordinate: TypeAlias = Annotated[float, Ge(-MOST), Le(MOST)]
Point: TypeAlias = tuple[Coordinate, Coordinate]
Rectangle: TypeAlias = tuple[Coordinate, Coordinate, Coordinate, Coordinate]


class ScenarioError(ValueError):
    """A scenario that can't be run. The message is one line that names the key and what would be right."""


@dataclass(frozen=True)
class FloorPlan:
    """Either free rectangles in solid wall, or a ROS `map_server` map."""

    size_m: tuple[Positive, Positive] | None = None
    """Width and height; the lower-left corner is the origin."""
    free: tuple[Rectangle, ...] = ()
    """x0, y0, x1, y1 of what is carved out of the wall."""
    walls: tuple[Rectangle, ...] = ()
    """x0, y0, x1, y1 of what is put back afterwards."""
    resolution_m: Positive | None = None
    """Side of a grid cell; None: 0.5, or that of the map. A map is resampled: a cell with any wall pixel is wall."""
    map: str | None = None
    """A map's YAML file, relative to the scenario's folder; instead of size and rectangles."""
    map_sha256: str | None = None
    """Refuse the map if its YAML and image have another digest (written when a run stores its scenario)."""


@dataclass(frozen=True)
class StationPlace:
    """The monitor station and what is known free around it."""

    position_m: Point | None = None
    """None: in the largest connected part of the floor, the place nearest to the middle that is 1 m clear of walls."""
    safety_zone_m: Rectangle | None = None
    """x0, y0, x1, y1; None: the largest square around the station, up to 3 m each way, that holds no wall."""
    start_radius_m: Positive | None = None
    """Robots start anywhere up to this far from the station that can be reached; None: 1 to 3 m away, in its sight."""


@dataclass(frozen=True)
class Cell:
    """A space whose search is measured: the free grid cells of a rectangle that can be reached from the MS."""

    name: Annotated[str, MinLen(1), MaxLen(100)]
    rectangle_m: Rectangle
    """x0, y0, x1, y1"""


@dataclass(frozen=True)
class Robot:
    """What is particular about one robot."""

    id: Annotated[int, Ge(1), Le(1000)]
    external: bool = False
    """Its process is none of the launcher's: a program of anybody's that reads its credentials file (docs/wire.md)."""


@dataclass(frozen=True)
class Victims:
    """The victims to be found."""

    per_cell: Annotated[int, Ge(0), Le(MAX_CELLS)] = 3
    """Seeded places in each search cell, unless positions are given."""
    positions_m: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Deadlines:
    """Deadlines of wall time. They do not show in a trace unless one is exceeded."""

    hang_s: Annotated[float, Ge(0.5), Le(MOST)] = 2.0
    """A node that neither answers nor works for this long is left out. It tells of its work four times a second."""
    think_s: Annotated[float, Ge(1), Le(MOST)] = 60.0
    """A node whose process spends more processor time than this on one tick is left out although it works."""
    medium_s: Annotated[float, Ge(1), Le(MOST)] = 30.0
    """A medium silent for this long fails the run."""
    return_s: Annotated[float, Ge(1), Le(MOST)] = 30.0
    """A scheduled restart whose process is not there after this long fails the run."""


@dataclass(frozen=True)
class Change:
    """A change of the radio during a run. The robots are not told: what they know of it is that of the start."""

    at_s: NotNegative
    set: Annotated[dict[str, Any], MinLen(1)]
    """Values by key, such as { "radio.loss" = 0.1 }. They hold until another change, or the end."""


@dataclass(frozen=True)
class Tables:
    """A scenario file as it stands, defaults filled in."""

    # Holds for the tables within too.
    __pydantic_config__ = ConfigDict(allow_inf_nan=False, extra="forbid")

    name: Annotated[str, MinLen(1)]
    """Of the scenario; run folders are called after it."""
    floor_plan: FloorPlan
    description: str = ""
    """For people."""
    policy: Annotated[str, MinLen(1)] = "vds"
    """The rules of the robots: vds (the paper's), scout, sortie, or module:Class."""
    robots: Annotated[int, Ge(1), Le(1000)] = 9
    """N"""
    radius_m: Annotated[float, Ge(NEAREST_M), Le(MOST)] = 20.0
    """r_t; the radio's curve begins at that distance"""
    seed: Annotated[int, Ge(0), Le(2**63 - 1)] = 1
    """Of everything random."""
    duration_s: Annotated[float, Gt(0), Le(1e8)] = 4000.0
    """Simulated time after which the run ends."""
    speed: Literal["max"] | Positive = "max"
    """Simulated seconds per second of wall time."""
    pose_noise_m: Annotated[float, Ge(0), Le(100)] = 0.0
    """Standard deviation of each coordinate that a robot senses of itself."""
    body_radius_m: Annotated[float, Ge(0), Le(10)] = 0.0
    """Robots are discs of this radius that do not pass through one another; 0: points that do."""
    station: StationPlace = field(default_factory=StationPlace)
    cell: Annotated[tuple[Cell, ...], MaxLen(1000)] = ()
    """Search cells; none: one cell `all` of everything that can be reached."""
    victims: Victims = field(default_factory=Victims)
    lidar: Lidar = field(default_factory=Lidar)
    radio: Radio = field(default_factory=Radio)
    rules: Rules = field(default_factory=Rules)
    deadlines: Deadlines = field(default_factory=Deadlines)
    fault: tuple[Fault, ...] = ()
    change: Annotated[tuple[Change, ...], MaxLen(1000)] = ()
    robot: Annotated[tuple[Robot, ...], MaxLen(1000)] = ()
    """Those about which there is something to say."""


def nearest(name: str, known: Sequence[str]) -> str:
    """A hint for the end of an error: the known name that is most like `name`, or all known names."""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"known: {shown(', '.join(known), 180)}"


def validate(raw: Mapping[str, Any]) -> Tables:
    """Check the raw tables of a scenario, as `tomllib` gives them.

    Raises:
        ScenarioError: an unknown key, a missing one, or a value out of its bounds.
    """
    return checked(TABLES, raw, Tables)


def validate_fault(raw: Any, index: int) -> Fault:
    """Check one [[fault]] by itself; `index`, from 0, is that in the scenario's list.

    Raises:
        ScenarioError: as `validate`.
    """
    return checked(_FAULT, raw, Fault, ("fault", index))


_WORDS: Final = {"an object": "a table", "a valid dictionary": "a table", "a valid array": "a list"}
"""What pydantic calls the values of a TOML file."""

T = TypeVar("T")
TABLES: TypeAdapter[Tables] = TypeAdapter(Tables)
_FAULT: TypeAdapter[Fault] = TypeAdapter(Fault)


def checked(adapter: TypeAdapter[T], raw: Any, kind: type[T], path: tuple[str | int, ...] = ()) -> T:
    """A dataclass from raw tables, as `tomllib` gives them.

    Args:
        adapter: of the dataclass.
        raw: the table.
        kind: the dataclass.
        path: keys that lead to the table in its file.

    Raises:
        ScenarioError: an unknown key, a missing one, or a value out of its bounds; in the words of a TOML file.
    """
    _refuse_unknown(raw, kind, path)
    # JSON knows no tuples, so with it pydantic takes lists for them and can be strict: no "9" for 9, no true for 1.
    try:
        text = json.dumps(raw, default=str)
    except ValueError:
        raise ScenarioError("a whole number of thousands of digits") from None
    try:
        return adapter.validate_json(text, strict=True)
    except ValidationError as error:
        if "recursion limit" in error.errors()[0]["msg"]:  # from Python 3.12 on json itself goes deeper than pydantic
            raise RecursionError from None
        raise ScenarioError(_first(error, raw, path)) from None


def _refuse_unknown(raw: Any, hint: Any, path: tuple[str | int, ...]) -> None:
    """Refuse keys that no dataclass has, along the type hints; pydantic finds wrong types."""
    kind = dataclass_in(hint)
    if kind is None:
        return
    if isinstance(raw, list):
        for i, item in enumerate(raw):
            _refuse_unknown(item, kind, (*path, i))
    if not isinstance(raw, Mapping):
        return
    hints = get_type_hints(kind, include_extras=True)
    for key, value in raw.items():
        if key not in hints:
            where = f" in [{_dotted(path)}]" if path else ""
            raise ScenarioError(f"unknown key '{shown(key)}'{where}, {nearest(key, list(hints))}")
        _refuse_unknown(value, hints[key], (*path, key))


def dataclass_in(hint: Any) -> Any:
    """The dataclass that a type hint is, or that it has in a tuple or union; None if there is none."""
    if dataclasses.is_dataclass(hint):
        return hint
    if get_origin(hint) is Annotated:
        return dataclass_in(get_args(hint)[0])
    if get_origin(hint) in (tuple, typing.Union, types.UnionType):
        return next((kind for kind in map(dataclass_in, get_args(hint)) if kind is not None), None)
    return None


def _first(error: ValidationError, raw: Any, path: tuple[str | int, ...]) -> str:
    """One line on the first error that pydantic found in the raw value at `path`."""
    errors = error.errors(include_url=False)
    paths = [(*path, *_keys_to(item["loc"], raw)) for item in errors]
    messages: list[str] = []
    for item, where in zip(errors, paths, strict=True):
        message = "is missing" if item["type"] == "missing" else item["msg"].replace("Input should", "should")
        for theirs, ours in _WORDS.items():
            message = message.replace(theirs, ours)
        if where == paths[0] and message not in messages:
            messages.append(message)
    what = " or ".join(messages)
    if errors[0]["type"] == "missing":
        return f"{_dotted(paths[0])} {what}"
    return f"{_dotted(paths[0])} = {shown(repr(errors[0]['input']))}: {what}"


def _keys_to(loc: tuple[str | int, ...], raw: Any) -> tuple[str | int, ...]:
    """The keys of the file that lead to pydantic's location, which also names members of unions."""
    keys: list[str | int] = []
    for part in loc:
        if isinstance(raw, Mapping) and isinstance(part, str):
            keys.append(part)
            raw = raw.get(part)
        elif isinstance(raw, list) and isinstance(part, int):
            keys.append(part)
            raw = raw[part] if part < len(raw) else None
    return tuple(keys)


def _dotted(path: Sequence[str | int]) -> str:
    text = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")
