"""Loads a scenario from its file, the overrides of the command line, and the defaults of the policy."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.policies import PolicyError, policy_class
from bus.excerpt import shown
from bus.numerals import decimal
from deploy.scenario.arena import survey
from deploy.scenario.changes import is_change, radio_changes, with_more
from deploy.scenario.files import located, read_source
from deploy.scenario.name import check_name
from deploy.scenario.scenario import Scenario
from deploy.scenario.tables import Robot, ScenarioError, Tables, validate, validate_fault
from world.config import Fault
from world.faults import check_fault, parse_fault

__all__ = ["load", "with_changes"]


def load(source: str | Path, overrides: Mapping[str, Any] | None = None, *, own_faults: bool = True) -> Scenario:
    """Load a scenario and check all of it.

    Args:
        source: name of a scenario in deploy/scenarios, path of a .toml file, or path of a ROS map's .yaml file.
        overrides: values by dotted key, such as {"radio.loss": 0.1}, put in before anything is checked. Those of
            "fault" are added to the scenario's own: a list of tables, of texts in the form of the command line, or
            of `Fault`. "external" is a list of ids of robots that are external, besides the scenario's own.
        own_faults: False leaves out the faults that the source itself has.

    Raises:
        ScenarioError: with one line that names the file, the key, and what would be right.
    """
    raw, path = read_source(str(source))
    if not own_faults:
        raw.pop("fault", None)
    values = dict(overrides or {})
    more, external = values.pop("fault", ()), values.pop("external", ())
    try:
        for key, value in values.items():
            _put(raw, key, value)
        plan = raw.get("floor_plan")
        if isinstance(plan, dict) and isinstance(plan.get("map"), str):
            plan["map"] = str(located(plan["map"], path.parent))
            if plan["map"].encode(errors="ignore").decode() != plan["map"]:
                raise ScenarioError(f"floor_plan.map = '{shown(plan['map'])}': the path is not UTF-8, as TOML must be")
        _apply_policy(raw)
        tables = _with_external(_with_faults(validate(raw), more), external)
        _check(tables)
        return Scenario(tables, survey(tables))
    except ScenarioError as error:
        raise ScenarioError(f"{shown(source)}: {error}") from None
    except RecursionError:
        raise ScenarioError(f"{shown(source)}: its lists or tables are nested too deeply") from None


def with_changes(scenario: Scenario, more: Sequence[Any]) -> Scenario:
    """The scenario with further faults and changes after its own.

    Args:
        scenario: as it is.
        more: tables as in [[fault]] or [[change]], texts in the form of the command line, `Fault`, or `Change`.

    Raises:
        ScenarioError: one of them is wrong, or does not fit the scenario; one line.
    """
    faults = [each for each in more if not is_change(each)]
    tables = with_more(_with_faults(scenario.tables, faults), [each for each in more if is_change(each)])
    _check(tables)
    return Scenario(tables, scenario.arena)


def _apply_policy(raw: dict[str, Any]) -> None:
    """Check the policy's name, and fill in its defaults for keys that the scenario does not have.

    Raises:
        ScenarioError: there is no such policy.
    """
    name = raw.get("policy", "vds")
    if not isinstance(name, str):
        return
    try:
        defaults = policy_class(name).DEFAULTS
    except PolicyError as error:
        raise ScenarioError(f"policy = '{shown(name)}': {shown(error, 300)}") from None
    for key, value in defaults.items():
        *tables, last = key.split(".")
        inner: Any = raw
        for table in tables:
            inner = inner.setdefault(table, {}) if isinstance(inner, dict) else None
        if isinstance(inner, dict):
            inner.setdefault(last, value)


def _put(raw: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    inner: Any = raw
    for i, table in enumerate(tables):
        inner = inner.setdefault(table, {})
        if not isinstance(inner, dict):
            what = shown(".".join(tables[: i + 1]))
            raise ScenarioError(f"cannot set '{shown(key)}', since '{what}' is no table of single keys")
    if key == "speed" and isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = decimal(value)
    inner[last] = value


def _with_faults(tables: Tables, more: Any) -> Tables:
    """The tables with further faults after their own."""
    if not isinstance(more, list | tuple):
        raise ScenarioError(f"fault = {shown(more)}: expected a list of faults")
    faults = list(tables.fault)
    for fault in more:
        if isinstance(fault, str):
            try:
                fault = parse_fault(fault)
            except ValueError as error:
                raise ScenarioError(str(error)) from None
        faults.append(fault if isinstance(fault, Fault) else validate_fault(fault, len(faults)))
    return dataclasses.replace(tables, fault=tuple(faults))


def _with_external(tables: Tables, more: Any) -> Tables:
    """The tables with further robots that are external."""
    if not isinstance(more, list | tuple) or any(type(robot) is not int for robot in more):
        raise ScenarioError(f"external = {shown(more)}: expected a list of ids of robots")
    robots = {robot.id: robot for robot in tables.robot}
    if len(robots) < len(tables.robot):
        raise ScenarioError("robot: a robot has two tables; each id may have one")
    robots |= {robot: dataclasses.replace(robots.get(robot, Robot(robot)), external=True) for robot in more}
    for robot in robots:
        if not 1 <= robot <= tables.robots:
            raise ScenarioError(f"robot {robot}: there are only robots 1 to {tables.robots}")
    return dataclasses.replace(tables, robot=tuple(robot for _, robot in sorted(robots.items())))


def _check(tables: Tables) -> None:
    """Check what depends on several fields."""
    check_name(tables.name)
    external = {robot.id for robot in tables.robot if robot.external}
    try:
        tables.rules.check()
    except ValueError as error:
        raise ScenarioError(f"rules.{error}") from None
    try:
        tables.radio.check()
    except ValueError as error:
        raise ScenarioError(f"radio.{error}") from None
    radio_changes(tables)
    for i, fault in enumerate(tables.fault, 1):
        try:
            check_fault(fault, tables.robots, tables.duration_s, external)
        except ValueError as error:
            raise ScenarioError(f"fault[{i}]: {error}") from None
