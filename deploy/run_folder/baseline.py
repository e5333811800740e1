"""What a new run takes from an earlier one: its faults, and its search times to compare with."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any

from bus.excerpt import shown
from deploy.json_file import read_object
from deploy.scenario.files import read_toml
from deploy.scenario.tables import ScenarioError

if TYPE_CHECKING:
    from deploy.scenario import Scenario

__all__ = ["Baseline", "faults_of"]

_NO_MATTER = ("name", "description", "fault", "change", "speed", "deadlines", "duration_s")
"""Keys of a scenario in which two runs may differ and still be compared."""


def faults_of(folder: Path) -> list[dict[str, Any]]:
    """All faults that acted in a run, by schedule or by hand, each in the form of a scenario's [[fault]].

    Raises:
        ScenarioError: there is no such run, or it has not ended.
    """
    faults = _summary_of(folder).get("faults")
    if not isinstance(faults, list):
        raise ScenarioError(f"{shown(folder / 'summary.json')} tells no faults")
    return faults


@dataclass(frozen=True)
class Baseline:
    """A run of the same scenario and seed, without the fault, with which another run is compared."""

    folder: Path
    search_time_s: Mapping[str, float | None]

    @classmethod
    def of(cls, folder: Path, scenario: Scenario) -> Baseline:
        """Read a run's summary.

        Raises:
            ScenarioError: there is no such run, it has not ended, or it is of another scenario or seed.
        """
        summary = _summary_of(folder)
        was = read_toml(folder / "scenario.toml")
        now = tomllib.loads(scenario.to_toml())
        for key in sorted({*was, *now}.difference(_NO_MATTER)):
            if was.get(key) != now.get(key):
                raise ScenarioError(f"{shown(folder)} can't be compared: its {shown(key)} is not this run's")
        return cls(folder, _times_s(folder, summary))

    def lost_s(self, search_time_s: Mapping[str, float | None]) -> dict[str, float | None]:
        """By cell and for `all`: search time beyond that of this run; None where either run did not search the cell."""
        lost: dict[str, float | None] = {}
        for name, took in search_time_s.items():
            before = self.search_time_s.get(name)
            lost[name] = None if took is None or before is None else round(took - before, 1)
        return lost


def _summary_of(folder: Path) -> dict[str, Any]:
    try:
        return read_object(folder / "summary.json")
    except ValueError as error:
        raise ScenarioError(str(error)) from None


def _times_s(folder: Path, summary: Mapping[str, Any]) -> dict[str, float | None]:
    """The search times of a summary, by cell."""
    times_s = summary.get("search_time_s") or {}
    if not isinstance(times_s, dict) or not all(type(time_s) in (float, int, NoneType) for time_s in times_s.values()):
        raise ScenarioError(f"{shown(folder / 'summary.json')}: search_time_s is not a mapping of names to times")
    return times_s
