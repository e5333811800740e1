"""A study: one scenario, axes along which it is varied, named variants of it, and what is drawn of the results.

All of it is checked before the first run: a study whose hundredth point is no valid scenario does not start.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import ConfigDict, TypeAdapter

from bus.excerpt import shown
from deploy.scenario import Scenario, ScenarioError, load
from deploy.scenario.files import located, read_toml
from deploy.scenario.name import check_name, name_of
from deploy.scenario.tables import checked, nearest

__all__ = ["Discard", "Point", "Study", "Variant", "absent", "load_study", "points_of", "runs_of", "study_names"]

FOLDER: Final = Path(__file__).resolve().parent.parent / "studies"
BASE: Final = "base"
"""Name of the only variant of a study that lists none."""

_RANGE: Final = re.compile(r"(-?[0-9]{1,9})\.\.(-?[0-9]{1,9})")
_MOST_STEPS: Final = 10_000
MOST_RUNS: Final = 10_000


@dataclass(frozen=True)
class Discard:
    """Runs that a figure leaves out: those that search `cell` before `before` (`statistics.goes_first`)."""

    cell: str
    before: str
    onset_rate: Annotated[float, Gt(0), Le(1)] = 0.1
    """Of a run that finishes neither cell, the first is the one whose search rate first reaches this share."""


@dataclass(frozen=True)
class Variant:
    """A named set of overrides, such as one rule switched off."""

    name: Annotated[str, MinLen(1)]
    set: dict[str, Any] = field(default_factory=dict)
    """Scenario keys, dotted or nested."""
    axes: dict[str, Any] = field(default_factory=dict)
    """Axes of this variant. They replace those of the study of the same name."""
    against: str | None = None
    """Variant with which the report compares this one. None: the first of the study; empty: none."""
    why: str = ""
    """What this variant shows, for the report."""


@dataclass(frozen=True)
class Study:
    """A study file as it stands, defaults filled in."""

    __pydantic_config__ = ConfigDict(allow_inf_nan=False, extra="forbid")

    name: Annotated[str, MinLen(1)]
    scenario: Annotated[str, MinLen(1)]
    """Name or path, as `run_local.py --scenario` takes it; a path is relative to the study's file, as is one of an axis
    or a variant."""
    plot: Literal["search_rate", "search_time", "variants"]
    title: str = ""
    set: dict[str, Any] = field(default_factory=dict)
    """Overrides of the scenario for all runs."""
    axes: dict[str, Any] = field(default_factory=dict)
    """By scenario key: a list of values, or "1..10" for whole numbers. All combinations are run. An axis whose values
    are tables varies several keys together; its name is free: fleet = [{robots = 6, radius_m = 12.0}, ...]."""
    quick: dict[str, Any] = field(default_factory=dict)
    """Axes for `--quick`. They replace those above."""
    variant: tuple[Variant, ...] = ()
    discard: Discard | None = None
    skip_absent: bool = False
    """Leave out the runs whose scenario is a path to no file, in place of refusing the study."""
    series_step_s: Annotated[int, Ge(1)] = 1
    """Simulated seconds between two rows of the time series."""


@dataclass(frozen=True)
class Point:
    """One run of a study, resolved."""

    key: str
    """Digest of the resolved scenario: equal keys are equal runs."""
    variant: str
    toml: str
    """The scenario as resolved; `load` of it gives this run."""
    effort: float
    """Expected work in a unit without meaning: points can be compared."""


def study_names() -> list[str]:
    """The studies that come with the emulator."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_study(source: str, *, quick: bool = False) -> Study:
    """Load a study by name or path; with `quick`, on its small grid.

    Raises:
        ScenarioError: with one line that names the file, the key, and what would be right.
    """
    path = Path(source)
    if path.suffix.lower() != ".toml":
        if source not in study_names():
            known = f"{nearest(source, study_names())} (or give a .toml file)"
            raise ScenarioError(f"unknown study '{shown(source)}', {known}")
        path = FOLDER / f"{source}.toml"
    raw = read_toml(path)
    try:
        study = checked(_ADAPTER, {"name": name_of(path.stem), **raw}, Study)
        _check(study)
    except ScenarioError as error:
        raise ScenarioError(f"{shown(source)}: {error}") from None
    study = _located(study, path.parent)
    if not quick:
        return study
    variants = tuple(dataclasses.replace(variant, axes={}) for variant in study.variant)
    return dataclasses.replace(study, axes=_flat(study.axes) | _flat(study.quick), variant=variants)


def absent(study: Study) -> list[str]:
    """The files that are not there and whose runs the study leaves out."""
    if not study.skip_absent:
        return []
    sources = [str(settings.get("scenario", study.scenario)) for _, settings in _combinations(study)]
    return [s for s in dict.fromkeys(sources) if Path(s).suffix and not Path(s).is_file()]


def runs_of(study: Study) -> int:
    """How many runs a study has at most: of those that are alike it has one."""
    variants = [_flat(study.axes) | _flat(variant.axes) for variant in study.variant or (Variant(BASE),)]
    return sum(math.prod(len(_values(key, values)) for key, values in axes.items()) for axes in variants)


def points_of(study: Study) -> list[Point]:
    """All runs of a study, longest expected first, so that the last to end are short ones.

    Raises:
        ScenarioError: a combination that is no valid scenario; the line names it.
    """
    points: dict[str, Point] = {}
    gone = absent(study)
    for variant, settings in _combinations(study):
        source = str(settings.pop("scenario", study.scenario))
        if source in gone:
            continue
        try:
            scenario = load(source, settings)
        except ScenarioError as error:
            which = shown(", ".join(f"{key}={value}" for key, value in settings.items()))
            raise ScenarioError(f"study {shown(study.name, 30)}, {shown(variant, 30)} ({which}): {error}") from None
        if scenario.not_in_process:
            where = f"study {shown(study.name, 30)}, {shown(variant, 30)}"
            raise ScenarioError(f"{shown(where)}: {shown(scenario.not_in_process)}")
        _check_discard(study.discard, scenario)
        point = _point(variant, scenario)
        points.setdefault(point.key, point)
    if not points:
        raise ScenarioError(f"study {shown(study.name, 30)}: none of its scenarios is there: {shown(', '.join(gone))}")
    return sorted(points.values(), key=lambda point: (-point.effort, point.key))


def _located(study: Study, folder: Path) -> Study:
    """The study with every scenario's path made absolute."""
    variants = tuple(
        dataclasses.replace(variant, set=_placed(variant.set, folder), axes=_placed(variant.axes, folder))
        for variant in study.variant
    )
    return dataclasses.replace(
        study,
        scenario=_placed({"scenario": study.scenario}, folder)["scenario"],
        set=_placed(study.set, folder),
        axes=_placed(study.axes, folder),
        quick=_placed(study.quick, folder),
        variant=variants,
    )


def _placed(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The table, its paths under the key `scenario` made absolute, in tables within it, too."""

    def at(value: Any, key: str) -> Any:
        if isinstance(value, Mapping):
            return _placed(value, folder)
        if isinstance(value, list):
            return [at(one, key) for one in value]
        named = key == "scenario" and isinstance(value, str)
        return str(located(value, folder)) if named and Path(value).suffix else value

    return {key: at(value, key) for key, value in table.items()}


def _check_discard(rule: Discard | None, scenario: Scenario) -> None:
    for key, cell in () if rule is None else (("cell", rule.cell), ("before", rule.before)):
        if cell not in scenario.cell_names:
            known = nearest(cell, [shown(name) for name in scenario.cell_names[:20]])
            raise ScenarioError(
                f"discard.{key} = '{shown(cell)}': scenario {shown(scenario.name, 30)} has no such cell, {known}"
            )


def _combinations(study: Study) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each run as the name of its variant and its overrides; a variant overrides axes, axes override `set`."""
    common = _flat(study.set)
    for variant in study.variant or (Variant(BASE),):
        axes = _flat(study.axes) | _flat(variant.axes)
        steps = [_steps(key, values) for key, values in axes.items()]
        for chosen in itertools.product(*steps):
            settings = {**common, **dict(itertools.chain(*map(dict.items, chosen))), **_flat(variant.set)}
            if "fault" in settings:
                settings["fault"] = _faults(settings["fault"])
            yield variant.name, settings


def _point(variant: str, scenario: Scenario) -> Point:
    toml = scenario.to_toml()
    key = hashlib.sha256(f"{variant}\n{toml}".encode()).hexdigest()[:16]
    # A short radius takes long. Only the order matters.
    return Point(key, variant, toml, scenario.duration_s * scenario.robots / (1.0 + scenario.radius_m / 10.0))


_ADAPTER: TypeAdapter[Study] = TypeAdapter(Study)


def _check(study: Study) -> None:
    check_name(study.name)
    for table in (study.axes, study.quick, *(variant.axes for variant in study.variant)):
        for key, values in _flat(table).items():
            _values(key, values)
    names = [variant.name for variant in study.variant]
    for variant in study.variant:
        if names.count(variant.name) > 1:
            raise ScenarioError(f"variant '{shown(variant.name)}' is there twice")
        if not variant.name.isprintable():
            raise ScenarioError(f"variant '{shown(variant.name)}': the name has control characters or line breaks")
        if variant.against and variant.against not in names:
            where = f"variant '{shown(variant.name)}': against = '{shown(variant.against)}'"
            raise ScenarioError(f"{where}: no such variant, {nearest(variant.against, [shown(n) for n in names])}")
    for axes in (study.axes, {**_flat(study.axes), **_flat(study.quick)}):
        if (runs := runs_of(dataclasses.replace(study, axes=axes))) > MOST_RUNS:
            raise ScenarioError(f"its axes make {runs:,} runs: up to {MOST_RUNS:,} are possible")
    if study.plot == "search_time" and "radius_m" not in _flat(study.axes):
        raise ScenarioError("plot = 'search_time' needs an axis radius_m")


def _values(key: str, given: Any) -> Sequence[Any]:
    if isinstance(given, str) and key != "fault" and (found := _RANGE.fullmatch(given)):
        first, last = map(int, found.groups())
        if last < first:
            raise ScenarioError(
                f"axes.{shown(key)} = '{shown(given)}': expected a range from a low number to a high one"
            )
        if last - first >= _MOST_STEPS:
            raise ScenarioError(f"axes.{shown(key)} = '{shown(given)}': more than {_MOST_STEPS:,} values")
        return range(first, last + 1)
    if not isinstance(given, list) or not given:
        what = 'expected a list of values, or a range such as "1..10"'
        raise ScenarioError(f"axes.{shown(key)} = {shown(repr(given))}: {what}")
    return given


def _steps(key: str, given: Any) -> list[dict[str, Any]]:
    """The settings at each step of an axis."""
    return [_flat(value) if isinstance(value, Mapping) else {key: value} for value in _values(key, given)]


def _faults(given: Any) -> list[Any]:
    """The faults of one run from one text or a list of texts; the empty text stands for none."""
    return [fault for fault in (given if isinstance(given, list) else [given]) if fault != ""]


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys: `rules.routing.sticky` unquoted in TOML is a table of tables."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat
