"""The table of the study `buildings`, docs/results/buildings.csv: a line per mission with what its page needs.

A study keeps its runs under `runs/`, which is not committed. The table outlives them: the page is written from it, and
it grows by what was run since.
"""

from __future__ import annotations

import csv
import functools
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from bus.numerals import decimal
from bus.user_file import read_text
from deploy.scenario import load
from deploy.sweep.lower_bound import LowerBound, lower_bound
from deploy.sweep.plan import Study, runs_of
from deploy.sweep.results import Results, ResultsError
from deploy.sweep.statistics import usable
from world.own_file import write_whole

__all__ = ["COLUMNS", "Cell", "Row", "cells_of", "merged", "read_table", "write_table"]

Row = Mapping[str, Any]

_TEXTS: Final = ("variant", "scenario", "policy", "status", "code", "trace_sha256")
_NUMBERS: Final = (
    "seed", "robots", "radius_m", "duration_s", "simulated_s", "known_free.share", "known_free.t50_s",
    "known_free.t90_s", "known_free.t100_s", "map_errors.free_called_wall", "connected_fraction",
    "planned_absences.fraction", "longest_absence_s", "information_age.median_s", "information_age.p95_s", "walked_m",
    "scan_reports.buffered", "wall_s", "bound.walk_s", "bound.sweep_s", "bound.chain", "bound.area_m2",
)  # fmt: skip
_MAY_LACK: Final = (
    "known_free.t50_s", "known_free.t90_s", "known_free.t100_s", "information_age.median_s", "information_age.p95_s",
    "bound.chain",
)  # fmt: skip
COLUMNS: Final = (*_TEXTS, *_NUMBERS)
_MOST_BYTES: Final = 2**24


@dataclass(frozen=True)
class Cell:
    """One building under one variant."""

    variant: str
    scenario: str
    seeds: int
    """How many are planned."""


def cells_of(study: Study) -> list[Cell]:
    """All cells of the study as planned, also those whose map is not there."""
    cells = []
    for variant in study.variant:
        buildings = (study.axes | variant.axes)["building"]
        alone = Study(study.name, study.scenario, study.plot, axes=dict(study.axes), variant=(variant,))
        seeds = runs_of(alone) // len(buildings)
        cells += [Cell(variant.name, Path(building["scenario"]).stem, seeds) for building in buildings]
    return cells


def read_table(path: Path) -> list[dict[str, Any]]:
    """The rows of a table; none if it is not there. Empty fields are None.

    Raises:
        ResultsError: it is no such table; one line that names the file.
    """
    if not path.exists():
        return []
    try:
        lines = list(csv.DictReader(io.StringIO(read_text(path, _MOST_BYTES))))
        return [
            {name: line[name].strip() for name in _TEXTS} | {name: _number(name, line[name]) for name in _NUMBERS}
            for line in lines
        ]
    except (ValueError, KeyError, AttributeError, csv.Error) as error:  # a line with fewer fields has None for text
        raise ResultsError(f"{shown(path)}: not the table of the study: {shown(error, 100)}") from None


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the table; equal rows give equal bytes.

    Raises:
        OSError: it can't be written.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([[_field(row[name]) for name in COLUMNS] for row in rows])
    write_whole(path, out.getvalue().encode())


def merged(study: Study, before: Sequence[Row], folder: Path) -> list[Row]:
    """The rows of a table with those of the study's folder, which replace the ones of the same mission; in study order.

    Missions that are no longer planned are left out.

    Args:
        study: `buildings`.
        before: rows of the table.
        folder: of the study's results; need not be there.

    Raises:
        ResultsError: its results can't be read.
    """
    rows = {_mission(row): row for row in before}
    rows |= {_mission(row): row for row in _measured(folder)}
    order = {(cell.variant, cell.scenario): i for i, cell in enumerate(cells_of(study))}
    planned = [mission for mission in rows if mission[:2] in order]
    return [rows[mission] for mission in sorted(planned, key=lambda mission: (order[mission[:2]], mission[2]))]


def _number(name: str, text: str) -> float | None:
    """The number of a field; None if it is empty and may be."""
    if not text.strip() and name in _MAY_LACK:
        return None
    value = decimal(text)
    if not math.isfinite(value):
        raise ValueError(f"{name} is not finite")
    return value


def _mission(row: Row) -> tuple[str, str, int]:
    return row["variant"], row["scenario"], int(row["seed"])


def _measured(folder: Path) -> list[dict[str, Any]]:
    """The rows of the study's folder that are results, with the lower bounds of their scenarios."""
    results = Results(folder)
    bound = functools.cache(lambda key: lower_bound(load(folder / "scenarios" / f"{key}.toml")))
    # Of all seeds of a cell the bounds are the same.
    first: dict[tuple[str, str], str] = {}
    rows = []
    for row in usable(results.rows()):
        key = first.setdefault((row["variant"], row["scenario"]), row["key"])
        rows.append({name: row.get(name) for name in COLUMNS} | _bounds(bound(key)))
    return rows


def _bounds(bound: LowerBound) -> dict[str, float | None]:
    return {
        "bound.walk_s": bound.walk_s, "bound.sweep_s": bound.sweep_s, "bound.chain": bound.chain,
        "bound.area_m2": bound.area_m2,
    }  # fmt: skip


def _field(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
