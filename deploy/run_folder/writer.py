"""Writes the folder of a run: summary.json, metrics.csv, events.jsonl and scenario.toml.

The snapshots and events of the world come from the launcher, or from the run in one process.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bus.excerpt import shown
from deploy.run_folder.claim import Claim, ClaimError
from deploy.run_folder.journal import read_journal
from deploy.run_folder.metrics import Metrics
from deploy.run_folder.summary import Finals, Progress, compare, summary_of
from monitor_station.config import JOURNAL, MAP
from world.feed import Event, Snapshot
from world.grid.map_file import save_map
from world.growing_file import GrowingFile
from world.own_file import write_whole
from world.terms import seconds_of
from world.unwritten import Unwritten

if TYPE_CHECKING:
    from deploy.run_folder.baseline import Baseline
    from deploy.scenario import Scenario

__all__ = ["RunFolder"]


class RunFolder:
    """The files of one run. A context manager that closes them."""

    def __init__(
        self,
        path: Path,
        scenario: Scenario,
        baseline: Baseline | None = None,
        *,
        overwrite: bool = False,
        reads: Sequence[Path] = (),
    ) -> None:
        """Claim the folder and create its first files.

        Args:
            path: of the folder; it need not be there.
            scenario: that is run.
            baseline: a run with which the summary compares this one.
            overwrite: an earlier run's files may be replaced.
            reads: files and folders that the run reads: they are not replaced.

        Raises:
            ClaimError: the folder is not for this run, or can't be written.
        """
        self.path = path
        self._scenario = scenario
        self._baseline = baseline
        self._progress = Progress(scenario.cell_names)
        self.unwritten = Unwritten()
        toml = scenario.to_toml()
        self.claim = Claim(path, overwrite=overwrite, reads=reads)
        try:
            (path / "scenario.toml").write_text(toml, encoding="utf-8")
            self.metrics = Metrics(path / "metrics.csv", scenario.cell_names)
            self._events = GrowingFile(path / "events.jsonl")
        except OSError as error:
            self.claim.undo()
            raise ClaimError(f"{shown(path)}: can't write there: {error.strerror}") from error

    def snapshot(self, snapshot: Snapshot) -> None:
        """Add a tick, in the order of ticks; some may be missing."""
        self._progress.add(snapshot)
        self.metrics.add(snapshot)

    def event(self, event: Event) -> None:
        """Write one line of events.jsonl."""
        line = {
            "tick": event.tick,
            "at_s": seconds_of(event.tick),
            "kind": event.kind,
            "node": event.node,
            "text": event.text,
            "data": event.data,
        }
        self._events.write(json.dumps(line) + "\n")

    def finish(
        self, finals: Finals, wall_s: float, *, status: str | None = None, failures: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Write the summary and return it.

        Args:
            finals: last counts by process, as far as they have come in. The journal stands in for those of the station,
                and the merged map is made from it, too.
            wall_s: how long the run took.
            status: replaces the status of the world, as when the world was lost.
            failures: what went wrong, one line each. Files that could not be written come after them.
        """
        for name, file in ("metrics.csv", self.metrics.file), ("events.jsonl", self._events):
            file.flush()
            if file.error is not None:
                self.unwritten.note(name, file.error)
        if "station" not in finals and (station := read_journal(self.path / JOURNAL, self._scenario)) is not None:
            finals = {**finals, "station": station.final()}
            with self.unwritten.noting(MAP):
                save_map(self.path / MAP, self._scenario.arena.geometry, station.merger.cells)
        summary = summary_of(self._scenario, self._progress, finals, wall_s, status)
        if self._baseline is not None:
            compare(summary, self._baseline)
        summary["failures"] = [*failures, *self.unwritten.lines]
        with self.unwritten.noting("summary.json"):
            write_whole(self.path / "summary.json", json.dumps(summary, indent=1) + "\n")
        return summary

    def discard(self) -> None:
        """Leave the folder as it was: this run can't begin."""
        self.close()
        self.claim.undo()

    def close(self) -> None:
        self.metrics.file.close()
        self._events.close()
        self.claim.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
