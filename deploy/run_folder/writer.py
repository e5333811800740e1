"""Writes the folder of a run: summary.json, metrics.csv, events.jsonl and scenario.toml.

The snapshots and events of the world come from the launcher, or from the run in one process.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from deploy.run_folder.metrics import Metrics
from deploy.run_folder.summary import Finals, Progress, compare, summary_of
from world.feed import Event, Snapshot
from world.terms import seconds_of

if TYPE_CHECKING:
    from deploy.run_folder.baseline import Baseline
    from deploy.scenario import Scenario

__all__ = ["RunFolder"]


class RunFolder:
    """The files of one run. A context manager that closes them."""

    def __init__(self, path: Path, scenario: Scenario, baseline: Baseline | None = None) -> None:
        """Create the folder and its first files; the summary compares the run with `baseline`.

        Raises:
            OSError: the folder can't be made or written.
        """
        path.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._scenario = scenario
        self._baseline = baseline
        self._progress = Progress(scenario.cell_names)
        (path / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
        # Files of an earlier run in the same folder must not pass for files of this one.
        for pattern in ("summary.json", "recording*.rrd", "journal", "map.yaml", "map.pgm", "logs/*.log"):
            for old in path.glob(pattern):
                old.unlink()
        self.metrics = Metrics(path / "metrics.csv", scenario.cell_names)
        self._events = (path / "events.jsonl").open("w", buffering=1, encoding="utf-8")

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
            finals: last counts by process, as far as they have come in.
            wall_s: how long the run took.
            status: replaces the status of the world, as when the world was lost.
            failures: what went wrong, one line each.
        """
        summary = summary_of(self._scenario, self._progress, finals, wall_s, status)
        if self._baseline is not None:
            compare(summary, self._baseline)
        summary["failures"] = list(failures)
        self.flush()
        draft = self.path / "summary.json.part"
        draft.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
        draft.replace(self.path / "summary.json")
        return summary

    def flush(self) -> None:
        """Write all rows and events so far to the disk."""
        self.metrics.flush()
        self._events.flush()
        os.fsync(self._events.fileno())

    def close(self) -> None:
        self.metrics.close()
        self._events.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
