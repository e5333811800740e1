"""Changes of the radio during a run: [[change]], checked, and what the radio is from which tick on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import TypeAdapter

from bus.excerpt import shown
from deploy.scenario.tables import Change, ScenarioError, Tables, checked
from medium.config import Radio
from world.terms import tick_of

__all__ = ["is_change", "radio_changes", "with_more"]

_RADIO: Final[TypeAdapter[Radio]] = TypeAdapter(Radio)
_CHANGE: Final[TypeAdapter[Change]] = TypeAdapter(Change)


def is_change(given: Any) -> bool:
    """Whether this stands for a change, and not for a fault."""
    return isinstance(given, Change) or (isinstance(given, Mapping) and "set" in given)


def with_more(tables: Tables, more: Sequence[Any]) -> Tables:
    """The tables with further changes after their own, each a `Change` or a table.

    Raises:
        ScenarioError: one of them is wrong in itself.
    """
    changes = list(tables.change)
    for change in more:
        known = isinstance(change, Change)
        changes.append(change if known else checked(_CHANGE, change, Change, ("change", len(changes))))
    return dataclasses.replace(tables, change=tuple(changes))


def radio_changes(tables: Tables) -> tuple[tuple[int, Radio], ...]:
    """(tick, the radio from that tick on), ascending. Each change keeps what the ones before it have set.

    Raises:
        ScenarioError: one of them sets what can't change, or a value out of its bounds.
    """
    radio = tables.radio
    told = []
    for i, change in sorted(enumerate(tables.change, 1), key=lambda each: tick_of(each[1].at_s)):
        try:
            radio = _changed(tables, radio, change)
        except ValueError as error:
            raise ScenarioError(f"change[{i}]: {error}") from None
        told.append((tick_of(change.at_s), radio))
    return tuple(told)


def _changed(tables: Tables, radio: Radio, change: Change) -> Radio:
    if change.at_s >= tables.duration_s:
        raise ValueError(f"at_s = {change.at_s:g} is not within the run's duration_s = {tables.duration_s:g}")
    values = {}
    for key, value in change.set.items():
        table, _, name = key.partition(".")
        if table != "radio" or not name:
            what = 'only those of the radio can, such as { "radio.loss" = 0.1 }'
            raise ValueError(f"'{shown(key)}' can't change during a run: {what}")
        values[name] = value
    radio = checked(_RADIO, dataclasses.asdict(radio) | values, Radio, ("radio",))
    try:
        radio.check()
    except ValueError as error:
        raise ValueError(f"radio.{error}") from None
    if radio.limited != tables.radio.limited:
        raise ValueError(
            "robots know from the start on whether bandwidth is limited, so that can't change during a run"
        )
    return radio
