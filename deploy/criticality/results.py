"""The folder of a criticality analysis: the mission, a row for each failure, tables, picture, and cases to run again.

A row is on the disk as soon as its branch has ended, so whatever ends the command costs the branches under way.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from bus.excerpt import shown
from bus.user_file import read_text
from deploy.json_file import read_object
from deploy.run_folder.claim import explained, refuse_foreign, take_lock
from world.own_file import write_whole

__all__ = ["Results", "ResultsError", "Row"]

Row = dict[str, Any]

LOCK: Final = "whatif.lock"
_WRITTEN: Final = (
    LOCK, "scenario.toml*", "asked.json*", "mission.json*", "rows.jsonl*", "criticality.*", "verdict.json*",
    "cases/*.toml*",
)  # fmt: skip
"""All that the command writes."""
_MOST_BYTES: Final = 2**30
_ROW: Final = {
    "robot": (int,), "at_s": (int, float), "orphans": (int,), "recovered": (bool,), "cost_robot_s": (int, float),
}  # fmt: skip
"""What a row has at least, and of which types."""


class ResultsError(ValueError):
    """A folder of another analysis, or one that can't be read; one line."""


class Results:
    """One folder, which belongs to this process until it is closed."""

    def __init__(self, folder: Path, asked: Mapping[str, Any], scenario_toml: str) -> None:
        """Take a folder that is new, empty, or of the same analysis.

        Args:
            folder: it is made if it is not there.
            asked: all that decides the rows besides the scenario, in JSON types.
            scenario_toml: of the mission.

        Raises:
            ClaimError: it holds something else, the command is at work there, or it can't be written.
            ResultsError: it holds another analysis.
        """
        self.folder = folder
        with explained(folder):
            folder.mkdir(parents=True, exist_ok=True)
            refuse_foreign(folder, _WRITTEN, "whatif.py", marked=(folder / LOCK).exists())
            self._lock = take_lock(folder / LOCK)
            try:
                self._begin(dict(asked), scenario_toml)
            except BaseException:
                self._lock.close()
                raise

    def _begin(self, asked: dict[str, Any], toml: str) -> None:
        if (self.folder / "asked.json").exists():
            try:
                same = _object(self.folder / "asked.json") == asked and self._stored_toml() == toml
            except ValueError as error:
                raise ResultsError(str(error)) from None
            if not same:
                what = "holds an analysis of another scenario, with other options, or by other code: name another --out"
                raise ResultsError(f"{shown(self.folder)}: {what}")
        else:
            write_whole(self.folder / "scenario.toml", toml)
            write_whole(self.folder / "asked.json", json.dumps(asked, indent=1) + "\n")
        rows = self.rows()
        # A row that was cut off by a kill goes, so that what follows begins a line.
        write_whole(self.folder / "rows.jsonl", "".join(f"{json.dumps(row)}\n" for row in rows))
        self._growing: IO[str] = (self.folder / "rows.jsonl").open("a", encoding="utf-8", buffering=1)

    def _stored_toml(self) -> str:
        return read_text(self.folder / "scenario.toml", _MOST_BYTES)

    def close(self) -> None:
        """Let another process have the folder."""
        self._growing.close()
        self._lock.close()

    def mission(self) -> dict[str, Any] | None:
        """The mission as it is, if it has been run."""
        path = self.folder / "mission.json"
        return _object(path) if path.exists() else None

    def note_mission(self, mission: Mapping[str, Any]) -> None:
        write_whole(self.folder / "mission.json", json.dumps(mission) + "\n")

    def add(self, row: Row) -> None:
        """Write one row to the disk."""
        self._growing.write(json.dumps(row) + "\n")
        self._growing.flush()
        os.fsync(self._growing.fileno())

    def rows(self) -> list[Row]:
        """All rows, by time and robot. A line that is no row does not count, so its branch is run again."""
        path = self.folder / "rows.jsonl"
        found: dict[tuple[float, int], Row] = {}
        for line in read_text(path, _MOST_BYTES, "replace").split("\n") if path.exists() else ():
            try:
                row = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if isinstance(row, dict) and all(type(row.get(key)) in kinds for key, kinds in _ROW.items()):
                found[row["at_s"], row["robot"]] = row
        return [found[key] for key in sorted(found)]

    def write_tables(self, rows: Sequence[Row]) -> None:
        """criticality.parquet and criticality.csv, from the rows."""
        names = list(rows[0])
        content = io.BytesIO()
        pq.write_table(pa.table({name: pa.array([row[name] for row in rows]) for name in names}), content)
        write_whole(self.folder / "criticality.parquet", content.getvalue())
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, names)
        writer.writeheader()
        writer.writerows(rows)
        write_whole(self.folder / "criticality.csv", text.getvalue())

    def write_cases(self, cases: Mapping[str, str]) -> None:
        """A scenario for each failure that did harm, by file name; earlier ones that are none any more go."""
        (self.folder / "cases").mkdir(exist_ok=True)
        for path in (self.folder / "cases").glob("*.toml"):
            if path.name not in cases:
                path.unlink()
        for name, toml in cases.items():
            write_whole(self.folder / "cases" / name, toml)

    def note_verdict(self, verdict: Mapping[str, Any]) -> None:
        write_whole(self.folder / "verdict.json", json.dumps(verdict, indent=1) + "\n")


def _object(path: Path) -> dict[str, Any]:
    try:
        return read_object(path)
    except ValueError as error:
        raise ResultsError(str(error)) from None
