"""The results of a study on disk: one file of rows, one of time series, and the exact scenario of every run.

A finished run is written at once to a part, a file of its own, and the parts are merged at the end. So `kill -9` costs
only the runs under way. Files appear under their names only when they are complete.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from bus.excerpt import shown
from bus.user_file import read_bytes, read_text
from deploy.json_file import read_object
from deploy.run_folder.claim import explained, refuse_foreign, take_lock
from deploy.sweep.plan import Point
from deploy.sweep.row import Finished
from deploy.sweep.statistics import usable
from world.own_file import write_whole

__all__ = ["WALL_COLUMNS", "Results", "ResultsError", "differences", "read_csv", "read_series"]

Row = dict[str, Any]
Series = dict[str, list[float]]

WALL_COLUMNS: Final = (
    "wall_s",
    "real_time_factor",
    "tick_ms",
    "tick_blame",
    "tick_phases",
    "ticked_unix_s",
    "engine",
    "code",
)
"""Columns, or prefixes of columns before a dot, that may differ between two runs of one scenario."""

LOCK: Final = "study.lock"
_WRITTEN: Final = (
    LOCK, "parts/*.json*", "scenarios/*.toml*", "results.parquet*", "results.csv*", "series.parquet*", "study.json*",
    "*.png", "*.svg",
)  # fmt: skip
"""All that a study writes."""

_FIRST: Final = ("key", "variant", "engine", "scenario", "seed", "robots", "radius_m", "status", "error")


_NUMBER: Final = (int, float)
_ROW: Final[dict[str, type | tuple[type, ...]]] = {
    "key": str,
    "variant": str,
    "status": str,
    "seed": int,
    "robots": int,
    "radius_m": _NUMBER,
}
_LINE: Final[dict[str, type | tuple[type, ...]]] = {"key": str, "cell": str, "time_s": _NUMBER, "search_rate": _NUMBER}
"""What each row of results.parquet and each of series.parquet has, at least."""
_MOST_BYTES: Final = 2**32


class ResultsError(ValueError):
    """Results that can't be read; one line that names the file."""


class Results:
    """The folder of one study's results."""

    def __init__(self, folder: Path) -> None:
        """Look at a folder, which need not be there."""
        self.folder = folder
        self._parts = folder / "parts"
        self._scenarios = folder / "scenarios"
        self._lock: IO[bytes] | None = None

    def claim(self) -> None:
        """Take the folder for this process: a new, an empty, or a study's. It is made if it is not there.

        Its lock says that it is a study's: no folder is, for what others are called that it holds.

        Raises:
            ClaimError: it holds something else, another study is under way there, or it can't be written.
        """
        with explained(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            refuse_foreign(self.folder, _WRITTEN, "study", marked=(self.folder / LOCK).exists())
            self._lock = take_lock(self.folder / LOCK)
            for path in (self._parts, self._scenarios):
                path.mkdir(exist_ok=True)

    def close(self) -> None:
        """Let another study have the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def check(self) -> None:
        """Check that the tables which are there can be read.

        Raises:
            ResultsError: one can't, or is no study's; one line that names the file.
        """
        rows, series = _read(self.folder / "results.parquet", _ROW), self.series()
        lacking = sum(row["key"] not in series for row in usable(rows))
        if lacking:
            raise ResultsError(
                f"{shown(self.folder / 'series.parquet')}: lacks {lacking} of the runs of results.parquet"
            )

    def rows(self) -> list[Row]:
        """All rows, by key.

        Raises:
            ResultsError: as `check`.
        """
        rows = {row["key"]: row for row in _read(self.folder / "results.parquet", _ROW)}
        rows |= {part["row"]["key"]: part["row"] for part in self._read_parts()}
        return [rows[key] for key in sorted(rows)]

    def series(self) -> dict[str, Series]:
        """Time series by key: `time_s` and each cell's search rate.

        Raises:
            ResultsError: as `check`.
        """
        series = read_series(self.folder / "series.parquet")
        return series | {part["row"]["key"]: part["series"] for part in self._read_parts()}

    def done(self, *, retry_failed: bool = False) -> set[str]:
        """Keys of the runs that need not be run again: all that ended or, with `retry_failed`, that have a result."""
        rows = self.rows()
        return {row["key"] for row in (usable(rows) if retry_failed else rows)}

    def damaged(self) -> list[Path]:
        """Parts that can't be read. They stay; the run of one of them is run again, and its part written anew."""
        return [path for path in sorted(self._parts.glob("*.json")) if _part(path) is None]

    def plan(self, points: Iterable[Point]) -> None:
        """Write down the exact scenario of every run, before any of them starts."""
        for point in points:
            path = self.scenario_path(point.key)
            if not path.exists():
                write_whole(path, point.toml)

    def scenario_path(self, key: str) -> Path:
        """The file for `run_local.py --scenario` that repeats one run."""
        return self._scenarios / f"{key}.toml"

    def add(self, finished: Finished) -> None:
        """Write one finished run to the disk."""
        text = json.dumps({"row": finished.row, "series": finished.series})
        write_whole(self._part_path(finished.row["key"]), text)

    def compact(self) -> None:
        """Merge everything into results.parquet, results.csv and series.parquet; parts that were merged go."""
        merged = [self._part_path(part["row"]["key"]) for part in self._read_parts()]
        rows, series = self.rows(), self.series()
        if not rows:
            return
        for row in rows:
            path = self.scenario_path(row["key"])
            row["scenario_toml"] = read_text(path, _MOST_BYTES) if path.exists() else row.get("scenario_toml")
        columns = _columns(rows)
        table = pa.table({name: _array([row.get(name) for row in rows]) for name in columns})
        _write_parquet(self.folder / "results.parquet", table)
        _write_csv(self.folder / "results.csv", [name for name in columns if name != "scenario_toml"], rows)
        _write_parquet(self.folder / "series.parquet", _series_table(series))
        for path in merged:
            path.unlink(missing_ok=True)

    def note(self, facts: Mapping[str, Any]) -> None:
        """Write facts on the execution (command, machine, wall time), which are no part of a result."""
        write_whole(self.folder / "study.json", json.dumps(facts, indent=1) + "\n")

    def noted(self) -> dict[str, Any]:
        """The facts that `note` wrote; empty if there are none."""
        try:
            return read_object(self.folder / "study.json")
        except ValueError:
            return {}

    def _part_path(self, key: str) -> Path:
        return self._parts / f"{key}.json"

    def _read_parts(self) -> list[dict[str, Any]]:
        """The parts. A damaged one does not count, so its run is run again."""
        return [part for path in sorted(self._parts.glob("*.json")) if (part := _part(path)) is not None]


def read_series(path: Path) -> dict[str, Series]:
    """The time series of a table by key; none if it is not there.

    Raises:
        ResultsError: it can't be read, or is none.
    """
    series: dict[str, Series] = {}
    for line in _read(path, _LINE):
        of_run = series.setdefault(line["key"], {"time_s": []})
        of_cell = of_run.setdefault(line["cell"], [])
        of_cell.append(line["search_rate"])
        if len(of_cell) > len(of_run["time_s"]):
            of_run["time_s"].append(line["time_s"])
    return series


def read_csv(path: Path) -> list[Row]:
    """The rows of a results.csv.

    Raises:
        ResultsError: it can't be read, or is no table of a study; one line that names the file.
    """
    try:
        text = read_text(path, _MOST_BYTES)
    except ValueError as error:
        raise ResultsError(str(error)) from None
    rows = [
        {name: value if _ROW.get(name) is str else _value(value) for name, value in line.items()}
        for line in csv.DictReader(io.StringIO(text, newline=""))
    ]
    for row in rows:
        if column := _lacks(row, _ROW):
            raise ResultsError(f"{shown(path)}: not a table of a study: column {column} is missing or damaged")
    return rows


def _value(text: str | None) -> Any:
    """What a field of a CSV file was: nothing, a truth value, a number, or a text."""
    if not text:
        return None
    if text in ("True", "False"):
        return text == "True"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _part(path: Path) -> dict[str, Any] | None:
    """What a part holds: the row and the series of the run that it is named after; None if it is damaged."""
    try:
        part = read_object(path)
    except ValueError:
        return None
    row, series = part.get("row"), part.get("series")
    if not isinstance(row, dict) or not isinstance(series, dict) or row.get("key") != path.stem or _lacks(row, _ROW):
        return None
    columns = list(series.values())
    if not all(isinstance(column, list) and len(column) == len(columns[0]) for column in columns):
        return None
    if columns and ("time_s" not in series or any(type(x) not in (int, float) for column in columns for x in column)):
        return None
    return part


def _lacks(row: Row, types: Mapping[str, type | tuple[type, ...]]) -> str | None:
    """The first column that a row does not have as it must be."""
    return next((name for name, kind in types.items() if not isinstance(row.get(name), kind)), None)


def differences(left: Iterable[Row], right: Iterable[Row]) -> list[str]:
    """The differences of runs that both have, one line each, without columns of wall time."""
    others = {row["key"]: row for row in right}
    lines = []
    for row in left:
        other = others.get(row["key"])
        if other is None:
            continue
        names = sorted(name for name in row.keys() | other.keys() if name.partition(".")[0] not in WALL_COLUMNS)
        lines += [
            f"{row['key']} {name}: {shown(row.get(name))} against {shown(other.get(name))}"
            for name in names
            if row.get(name) != other.get(name) and name != "scenario_toml"
        ]
    return lines


def _columns(rows: list[Row]) -> list[str]:
    seen = {name: None for row in rows for name in row}
    return [*(name for name in _FIRST if name in seen), *(name for name in seen if name not in _FIRST)]


def _array(values: list[Any]) -> Any:
    """A column; values of mixed types, such as "max" and 2.0, become text."""
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if value is None else str(value) for value in values])


def _series_table(series: Mapping[str, Series]) -> Any:
    keys: list[str] = []
    cells: list[str] = []
    times: list[float] = []
    rates: list[float] = []
    for key in sorted(series):
        of_run = series[key]
        for cell in sorted(of_run.keys() - {"time_s"}):
            keys += [key] * len(of_run[cell])
            cells += [cell] * len(of_run[cell])
            times += of_run["time_s"]
            rates += of_run[cell]
    columns = {"key": pa.array(keys, pa.string()), "cell": pa.array(cells, pa.string())}
    columns |= {"time_s": pa.array(times, pa.float64()), "search_rate": pa.array(rates, pa.float64())}
    return pa.table(columns)


def _read(path: Path, types: Mapping[str, type | tuple[type, ...]]) -> list[Row]:
    """The rows of a table, each with columns of these types; none if it is not there."""
    if not path.exists():
        return []
    try:
        content = read_bytes(path, _MOST_BYTES)
    except ValueError as error:
        raise ResultsError(str(error)) from None
    try:
        rows: list[Row] = pq.read_table(pa.BufferReader(content)).to_pylist()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ResultsError(f"{shown(path)}: not a whole Parquet table: {shown(error, 120)}") from None
    for row in rows:
        if column := _lacks(row, types):
            raise ResultsError(f"{shown(path)}: not a table of a study: column {column} is missing or damaged")
    return rows


def _write_parquet(path: Path, table: Any) -> None:
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    write_whole(path, content.getvalue())


def _write_csv(path: Path, columns: list[str], rows: list[Row]) -> None:
    content = io.StringIO(newline="")
    writer = csv.DictWriter(content, columns, extrasaction="ignore")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, content.getvalue())
