"""Reads the folder of a run, for reports. Any of its files may be damaged or missing."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bus.excerpt import shown
from bus.user_file import read_text
from deploy.json_file import read_object
from deploy.run_folder.metrics import RATE
from deploy.scenario import Scenario, ScenarioError, load
from world.grid import GridGeometry
from world.grid.map_file import read_map

__all__ = ["MergedMap", "Run", "RunFilesError", "read_run"]

_LONGEST_S: Final = 1e9
_MOST_BYTES: Final = 2**30


class RunFilesError(ValueError):
    """A run folder that can't be read; one line that names the file."""


@dataclass(frozen=True)
class MergedMap:
    """The map that the MS merged."""

    cells: NDArray[np.int8]
    """(rows, cols) of FREE, OCCUPIED and UNKNOWN; row 0 at the lowest y"""
    geometry: GridGeometry


@dataclass(frozen=True)
class Run:
    """One run, as its folder has it."""

    path: Path
    summary: dict[str, Any]
    times_s: list[float]
    """Of the rows of metrics.csv."""
    columns: dict[str, list[float | None]]
    """Columns of metrics.csv by name, None where a field is empty."""
    events: list[dict[str, Any]]
    scenario_toml: str
    scenario: Scenario | None
    """None if scenario.toml is missing or its map has gone."""
    map: MergedMap | None

    @property
    def name(self) -> str:
        return self.path.resolve().name

    @property
    def search_rates(self) -> dict[str, list[float | None]]:
        """Columns of the cells by the cell's name."""
        return {key.removeprefix(RATE): column for key, column in self.columns.items() if key.startswith(RATE)}

    def group(self, key: str) -> dict[str, Any]:
        """A group of fields of the summary; empty if it is missing."""
        value = self.summary.get(key)
        return value if isinstance(value, dict) else {}

    def rows(self, key: str) -> list[dict[str, Any]]:
        """A list of groups of fields of the summary; empty if it is missing."""
        value = self.summary.get(key)
        return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []


def read_run(path: Path) -> Run:
    """Read a run folder.

    Raises:
        RunFilesError: it is no folder of a run that has ended, or one of its files is damaged.
    """
    try:
        if not path.is_dir():
            raise RunFilesError(f"{shown(path)}: no such run folder")
        summary = _summary(path / "summary.json")
        times_s, columns = _metrics(path / "metrics.csv")
        toml, scenario = _scenario(path / "scenario.toml")
        events = list(_events(path / "events.jsonl"))
        return Run(path, summary, times_s, columns, events, toml, scenario, _map(path / "map.yaml"))
    except OSError as error:
        raise RunFilesError(f"{shown(path)}: can't look into it: {error.strerror}") from None


def _text(path: Path) -> str:
    try:
        return read_text(path, _MOST_BYTES)
    except ValueError as error:
        raise RunFilesError(str(error)) from None


def _summary(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise RunFilesError(f"{shown(path)}: not there: no run folder, or its run has not ended")
    try:
        summary = read_object(path)
    except ValueError as error:
        raise RunFilesError(str(error)) from None
    if "status" not in summary:
        raise RunFilesError(f"{shown(path)}: not the summary of a run")
    return summary


def _metrics(path: Path) -> tuple[list[float], dict[str, list[float | None]]]:
    rows = csv.DictReader(io.StringIO(_text(path), newline=""))
    try:
        names = rows.fieldnames or []
        if "time_s" not in names:
            raise RunFilesError(f"{shown(path)}: has no column time_s")
        if len(set(names)) < len(names):
            raise RunFilesError(f"{shown(path)}: has two columns of one name")
        columns: dict[str, list[float | None]] = {name: [] for name in names}
        for row in rows:
            for name in names:
                columns[name].append(_number(row[name]))
    except (csv.Error, ValueError) as error:
        if isinstance(error, RunFilesError):
            raise
        raise RunFilesError(f"{shown(path)}: line {rows.line_num}: not numbers") from None
    times_s = columns.pop("time_s")
    if None in times_s:
        raise RunFilesError(f"{shown(path)}: a row without time_s")
    return [time_s for time_s in times_s if time_s is not None], columns


def _number(text: str | None) -> float | None:
    if not text:
        return None
    value = float(text)
    return value if np.isfinite(value) else None


def _events(path: Path) -> Iterator[dict[str, Any]]:
    """The lines that are events. The last one of a killed run may be cut off."""
    if not path.exists():
        return
    for line in _text(path).split("\n"):
        try:
            event = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(event, dict) and isinstance(event.get("at_s"), int | float) and abs(event["at_s"]) < _LONGEST_S:
            yield event


def _scenario(path: Path) -> tuple[str, Scenario | None]:
    if not path.exists():
        return "", None
    toml = _text(path)
    try:
        return toml, load(path)
    except ScenarioError:
        return toml, None


def _map(path: Path) -> MergedMap | None:
    """The merged map; None if the run left none, as when its station was lost."""
    if not path.exists():
        return None
    try:
        # The image lies beside the YAML file: a report reads no other folder.
        return MergedMap(*read_map(path, f"{path.stem}.pgm"))
    except ValueError as error:
        raise RunFilesError(str(error)) from None
