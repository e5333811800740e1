"""One study, or some of its runs, carried out while somebody looks on: how far they are, what came of them."""

from __future__ import annotations

import contextlib
import os
import platform
import random
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bus.excerpt import shown
from deploy.run_folder.status import meaning_of
from deploy.scenario import load, parse_set
from deploy.scenario.tables import nearest
from deploy.sweep.bounds import bounds_of
from deploy.sweep.plan import Point, Study
from deploy.sweep.results import Results, ResultsError, differences
from deploy.sweep.row import Engine, code_version, columns_of
from deploy.sweep.statistics import usable
from deploy.sweep.workers import Execution, Workers

__all__ = ["Asked", "carry_out", "sample", "select"]


@dataclass(frozen=True)
class Asked:
    """What the user asked for."""

    command: str
    """Without the options that change no result, for the note."""
    engine: Engine
    crew: int | str
    """Number of workers, or what they are, for the note."""
    retry_failed: bool = False
    compare: Path | None = None
    """Folder of the results to compare with."""


def select(points: list[Point], only: Sequence[str]) -> list[Point]:
    """The points that have what is asked for.

    Args:
        points: of the study.
        only: "KEY=VALUE", where a key is a column of parameters, such as seed, policy, variant or scenario.
            Of several values for a key any will do.

    Raises:
        ScenarioError: one is not of that form.
        ValueError: no point has such a key, or none has all that is asked for.
    """
    asked: dict[str, list[Any]] = {}
    for text in only:
        key, value = parse_set(text)
        asked.setdefault(key, []).append(value)
    parameters = {point.key: _parameters(point) for point in points}
    known = dict.fromkeys(key for of_point in parameters.values() for key in of_point)
    for key in asked:
        if key not in known:
            raise ValueError(f"--only {shown(key)}: no run has such a parameter, {nearest(key, list(known))}")
    chosen = [point for point in points if all(parameters[point.key].get(key) in asked[key] for key in asked)]
    if not chosen:
        raise ValueError(f"--only {shown(', '.join(only))}: no run of the study is so")
    return chosen


def sample(points: list[Point], count: int | None) -> list[Point]:
    """So many of the points, chosen at random, always the same ones; all of them if there are no more, or for None."""
    if count is None or count >= len(points):
        return points
    # Sorted first, so that the order of points, which is about speed, does not change the choice.
    chosen = {point.key for point in random.Random(0).sample(sorted(points, key=lambda p: p.key), count)}
    return [point for point in points if point.key in chosen]


def _parameters(point: Point) -> dict[str, Any]:
    tables = tomllib.loads(point.toml)
    return {**columns_of(tables), "variant": point.variant, "scenario": tables["name"]}


def carry_out(study: Study, points: list[Point], workers: Workers | None, folder: Path, asked: Asked) -> bool:
    """Run what is not done, draw all of it, and tell; without workers only what is there is drawn.

    Returns:
        Whether every run has a result, and the comparison found no difference.

    Raises:
        ClaimError: the folder is in use, or holds what no study wrote.
        ResultsError: there is no result yet.
    """
    results = Results(folder)
    with contextlib.closing(results):
        if workers is not None or folder.exists():
            results.claim()
        console = Console()
        if workers is not None:
            results.plan(points)
            _execute(study, points, workers, results, console, asked)
        planned = {point.key for point in points}
        rows = results.rows()
        if not rows:
            raise ResultsError(f"{shown(folder)}: no results yet")
        here = [row for row in rows if row["key"] in planned]
        _draw(study, here, results, console)
        whole = _tell_failures(here, console)
        return (asked.compare is None or _compare(here, planned, asked.compare, console)) and whole


def _execute(
    study: Study, points: list[Point], workers: Workers, results: Results, console: Console, asked: Asked
) -> None:
    done = results.done(retry_failed=asked.retry_failed)
    todo = [point for point in points if point.key not in done]
    _say(console, f"{study.name}: {len(points)} runs, {len(points) - len(todo)} of them done, in {results.folder}")
    if damaged := results.damaged():
        _say(
            console,
            f"{len(damaged)} files in {results.folder / 'parts'} are damaged and count as "
            f"not run, such as {damaged[0].name}",
        )
    _warn_of_other_code(results, {point.key for point in points}, console)
    execution = Execution(workers, asked.engine, study.series_step_s)
    begun, count = time.monotonic(), 0
    try:
        with _bar(console) as bar:
            task = bar.add_task(study.name, total=sum(point.effort for point in todo), runs=0, of=len(todo))
            for count, (point, finished) in enumerate(execution.results(todo), 1):
                results.add(finished)
                if not meaning_of(finished.row["status"]).result:
                    bar.console.print(f"run {point.key} failed: {finished.row['error']}", markup=False, soft_wrap=True)
                bar.update(task, advance=point.effort, runs=count)
    finally:
        results.compact()
        if count:
            _note(results, asked, time.monotonic() - begun, count)


def _warn_of_other_code(results: Results, planned: set[str], console: Console) -> None:
    others = [row for row in results.rows() if row["key"] in planned and row.get("code") != code_version()]
    if others:
        _say(console, f"{len(others)} of the rows there come from other code (column code); remove {results.folder} "
             "to run them anew")  # fmt: skip


def _bar(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[runs]}/{task.fields[of]} runs"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    # Runs take minutes, so the estimate needs a long period.
    return Progress(*columns, console=console, speed_estimate_period=3600.0)


def _note(results: Results, asked: Asked, wall_s: float, runs: int) -> None:
    """Write down how the results were made; a resumed study adds up."""
    before = results.noted()
    results.note({
        "command": asked.command,
        "wall_s": round(before.get("wall_s", 0.0) + wall_s, 1),
        "runs": before.get("runs", 0) + runs,
        "workers": asked.crew,
        "machine": f"{os.cpu_count()} cores, {_processor()}, {platform.system()}, Python {platform.python_version()}",
    })  # fmt: skip


def _processor() -> str:
    """Name of the processor, if the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _draw(study: Study, rows: Sequence[dict[str, Any]], results: Results, console: Console) -> None:
    from deploy.sweep.plots import draw  # late: Matplotlib takes a second

    fleets = {row["robots"] for row in rows} if study.plot == "search_time" else ()
    for path in draw(study, rows, results.series(), bounds_of(load(study.scenario), fleets), results.folder):
        _say(console, f"drawn: {path}")


def _tell_failures(rows: list[dict[str, Any]], console: Console) -> bool:
    """Whether none failed."""
    failed = len(rows) - len(usable(rows))
    if failed:
        _say(console, f"{failed} of {len(rows)} runs failed, see column error; --retry-failed runs them again")
    return not failed


def _compare(rows: list[dict[str, Any]], planned: set[str], other: Path, console: Console) -> bool:
    """Whether the other results are the same, wall times aside."""
    others = [row for row in Results(other).rows() if row["key"] in planned]
    lines = differences(rows, others)
    for line in lines:
        _say(console, line)
    _say(console, f"compared with {other}: {len(others)} runs in common, {len(lines)} differences")
    return bool(others) and not lines


def _say(console: Console, words: str) -> None:
    console.print(words, markup=False, highlight=False, soft_wrap=True)
