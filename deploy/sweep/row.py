"""One run of a study, on any machine: from the text of a scenario to a row of the results and time series.

A worker needs only this package: the text comes with the task, row and series return as its result.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from bus.built import ROOT, built_from
from bus.excerpt import shown
from deploy.failures import Crash
from deploy.run_folder.status import ERROR
from deploy.run_folder.summary import shortfall
from deploy.run_folder.writer import RunFolder
from deploy.scenario import Scenario, load
from deploy.simulation import Observer, Simulation

__all__ = ["Engine", "Finished", "code_version", "columns_of", "digest_of", "failed_row", "run_point"]

Engine = Literal["in-process", "processes"]

_DECIDE: Final = (
    "bus", "world", "medium", "agents", "monitor_station", "deploy/scenario", "deploy/run_folder", "deploy/processes",
    "deploy/failures.py", "deploy/simulation.py", "deploy/sweep/row.py",
)  # fmt: skip
"""Sources that decide the row of a run, besides the compiled loops."""
_LONGEST_ERROR: Final = 300
_TOLD: Final[set[str]] = set()
"""Kinds of exceptions whose traceback this worker has printed."""

_LEFT_OUT: Final = ("description", "floor_plan", "cell", "station", "deadlines", "speed", "name")
"""Keys of a scenario that are no columns: the floor plan, and what can't change a result."""


@dataclass(frozen=True)
class Finished:
    """The result of a run."""

    row: dict[str, Any]
    """Parameters and fields of the summary by column; keys within keys are dotted, lists are JSON text."""
    series: dict[str, list[float]]
    """`time_s`, and the search rate of each cell by its name: one value per step."""


def run_point(key: str, variant: str, toml: str, engine: Engine, series_step_s: int) -> Finished:
    """Run a scenario to its end. An exception becomes a row, too."""
    begun = time.monotonic()
    try:
        with tempfile.TemporaryDirectory(prefix="vds-study-") as temporary:
            return _run(key, variant, toml, engine, series_step_s, Path(temporary))
    except Exception as error:  # one bad run must not end a study of hundreds
        crash = Crash.of(error)
        if crash.kind not in _TOLD:
            _TOLD.add(crash.kind)
            print(
                f"{crash.traceback}\n(in run {key}; later ones of this worker in the same way are not told)",
                file=sys.stderr,
            )
        row = failed_row(key, variant, toml, engine, crash.headline)
        return Finished({**row, "wall_s": round(time.monotonic() - begun, 3)}, {})


def failed_row(key: str, variant: str, toml: str, engine: Engine, words: str) -> dict[str, Any]:
    """The row of a run without a summary."""
    return {**_head(key, variant, toml, engine), "status": ERROR, "error": shown(words, _LONGEST_ERROR)}


def _run(key: str, variant: str, toml: str, engine: Engine, series_step_s: int, temporary: Path) -> Finished:
    source = temporary / "scenario.toml"
    source.write_text(toml, encoding="utf-8")
    scenario = load(source)
    with RunFolder(temporary / f"study-{key}", scenario) as folder:
        if engine == "in-process":
            summary = _in_process(scenario, folder)
        else:
            summary = _with_processes(scenario, folder, temporary)
    row = {**_head(key, variant, toml, engine), **columns_of(summary), "error": shortfall(summary)}
    if summary["failures"]:
        row |= {"status": ERROR, "error": shown(summary["failures"][0], _LONGEST_ERROR)}
    return Finished(row, folder.metrics.series(series_step_s))


def _in_process(scenario: Scenario, folder: RunFolder) -> dict[str, Any]:
    result = Simulation(scenario, Observer(folder.snapshot, folder.event)).run()
    return folder.finish(result.finals, result.wall_s)


def _with_processes(scenario: Scenario, folder: RunFolder, temporary: Path) -> dict[str, Any]:
    from bus.session import local_endpoint
    from deploy.machine.limits import allow_files
    from deploy.processes.fleet import Fleet
    from deploy.processes.launcher import Launcher
    from deploy.screen.view import NoView

    allow_files(scenario.robots)
    fleet = Fleet(scenario, folder.path, local_endpoint(temporary, scenario.robots), record=False)
    return Launcher(fleet, folder, NoView()).run().summary


def _head(key: str, variant: str, toml: str, engine: Engine) -> dict[str, Any]:
    tables = tomllib.loads(toml)
    parameters = columns_of({name: value for name, value in tables.items() if name not in _LEFT_OUT})
    return {
        "key": key,
        "variant": variant,
        "engine": engine,
        "code": code_version(),
        "scenario": tables["name"],
        **parameters,
    }


@functools.cache
def code_version() -> str:
    """Digest of the sources that decide a run's result, on this machine; the same for the compiled form."""
    return digest_of(ROOT, built_from())


def digest_of(root: Path, loops: Mapping[str, str]) -> str:
    """Digest of the sources below `root` that decide a run's result, and of those that the `loops` were built from."""
    digest = hashlib.sha256(json.dumps(loops, sort_keys=True).encode())
    for name in _DECIDE:
        place = root / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            source = path.read_bytes()
            digest.update(f"\n{path.relative_to(root)} {len(source)}\n".encode() + source)
    return digest.hexdigest()[:12]


def columns_of(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested fields as one row: `{"frames": {"sent": 3}}` becomes `{"frames.sent": 3}`."""
    row: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            row |= columns_of(value, f"{prefix}{key}.")
        else:
            row[prefix + key] = json.dumps(value) if isinstance(value, list | tuple) else value
    return row


def end_after(lifeline: Any) -> None:
    """End this process once the other end of a pipe is closed. Runs in a thread of a worker."""
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)
