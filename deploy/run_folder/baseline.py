"""What an earlier run tells a new one: the faults that befell it, and how long its search took."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deploy.scenario.files import read_toml
from deploy.scenario.tables import ScenarioError

if TYPE_CHECKING:
    from deploy.scenario import Scenario

__all__ = ["Baseline", "faults_of"]

_NO_MATTER = ("name", "description", "fault", "speed", "deadlines", "duration_s")
"""Keys of a scenario in which two runs may differ and still be compared."""


def faults_of(folder: Path) -> list[dict[str, Any]]:
    """Everything that acted in a run, by schedule or by hand, each as a scenario's [[fault]] has it.

    Raises:
        ScenarioError: there is no such run, or it has not ended.
    """
    faults = _summary_of(folder).get("faults")
    if not isinstance(faults, list):
        raise ScenarioError(f"{folder / 'summary.json'} tells no faults")
    return faults


@dataclass(frozen=True)
class Baseline:
    """A run with which another is compared: of the same scenario and seed, without the fault."""

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
                raise ScenarioError(f"{folder} can't be compared: its {key} is not this run's")
        return cls(folder, summary.get("search_time_s") or {})

    def lost_s(self, search_time_s: Mapping[str, float | None]) -> dict[str, float | None]:
        """Search time beyond this baseline's, by cell and for `all`; None where either run did not get that far."""
        lost: dict[str, float | None] = {}
        for name, took in search_time_s.items():
            before = self.search_time_s.get(name)
            lost[name] = None if took is None or before is None else round(took - before, 1)
        return lost


def _summary_of(folder: Path) -> dict[str, Any]:
    path = folder / "summary.json"
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScenarioError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise ScenarioError(f"{path}: {error}") from None
    if not isinstance(summary, dict):
        raise ScenarioError(f"{path} is no summary")
    return summary
