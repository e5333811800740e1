#!/usr/bin/env python3
"""Run studies and draw their results: `deploy/study.py fig7`, `deploy/study.py PATH.toml --dask HOST:8786`.

The same command goes on where an interrupted study stopped. Exit status: 0 when every run has a result, 1 when one
failed (or `--compare` found a difference), 2 for bad input (one line, before anything starts), 130 when interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import random
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rich.console import Console

    from deploy.command import Parser
    from deploy.sweep.plan import Point, Study
    from deploy.sweep.results import Results
    from deploy.sweep.workers import Workers

ALSO_NEEDED: Final = ("matplotlib", "pyarrow")
REPORT: Final = "report"
"""Word for the command line, instead of a study: write docs/results.md and docs/policies.md from the results."""
_MANY_RUNS: Final = 1000
"""So many take some seconds to check."""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, a_whole_number

    p = Parser(prog="study.py", description="Run studies of many runs each, and draw their results.")
    p.add_argument("study", nargs="+", help="fig6, fig7, ablations, ...; a .toml file; or: report")
    p.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default runs/studies/NAME)")
    p.add_argument(
        "--workers", type=a_whole_number, metavar="N", help="processes of this machine (default: one per core)"
    )
    p.add_argument("--processes", action="store_true", help="run each as real processes, not in one")
    p.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster, such as tcp://HOST:8786")
    p.add_argument("--quick", action="store_true", help="the study's small grid")
    p.add_argument(
        "--sample", type=a_whole_number, metavar="N", help="only N of its runs, chosen at random, always the same"
    )
    p.add_argument("--compare", type=Path, metavar="DIR", help="then compare with the results there, wall times aside")
    p.add_argument("--retry-failed", action="store_true", help="run failed runs again")
    p.add_argument("--plot-only", action="store_true", help="run nothing, draw what is there")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Check everything, then run; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import INTERRUPTED, refuse, require

    require(Path(__file__), ALSO_NEEDED)
    from deploy.machine.limits import one_thread

    one_thread()
    from deploy.scenario import ScenarioError
    from deploy.sweep.plan import load_study, points_of, runs_of
    from deploy.sweep.results import Results
    from deploy.sweep.workers import WorkersGoneError

    if options.study == [REPORT]:
        return _report(options.out)
    try:
        _check(options)
        plans = []
        for source in options.study:
            study = load_study(source, quick=options.quick)
            Results(_folder(study, options)).check()
            if (runs := runs_of(study)) > _MANY_RUNS:
                print(f"{study.name}: checking its {runs:,} runs", flush=True)
            plans.append((study, _sampled(points_of(study), options.sample)))
        workers = None if options.plot_only else _workers(options)
    except (ScenarioError, OSError, ValueError) as error:
        return refuse("study.py", error)
    try:
        return max([_run(study, points, workers, options) for study, points in plans])
    except KeyboardInterrupt:
        print("study.py: interrupted; the same command goes on from here", file=sys.stderr)
        return INTERRUPTED
    except (OSError, WorkersGoneError) as error:
        print(f"study.py: {error}; the same command goes on from here", file=sys.stderr)
        return 1
    finally:
        if workers is not None:
            workers.close()


def _check(options: argparse.Namespace) -> None:
    if REPORT in options.study:
        raise ValueError("report stands alone")
    if options.out is not None and len(options.study) > 1:
        raise ValueError("--out takes one study")
    for name in ("workers", "sample"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise ValueError(f"--{name} {value}: at least 1")
    if options.compare is not None:
        from bus.excerpt import shown
        from deploy.sweep.results import Results

        try:
            there = Results(options.compare).rows()
        except (OSError, ValueError) as error:
            raise ValueError(f"--compare {error}") from None
        if not there:
            raise ValueError(f"--compare {shown(options.compare)}: no results.parquet there, and no run that is done")


def _sampled(points: list[Point], count: int | None) -> list[Point]:
    if count is None or count >= len(points):
        return points
    # Sorted first, so that the order of points, which is about speed, does not change the choice.
    chosen = {point.key for point in random.Random(0).sample(sorted(points, key=lambda p: p.key), count)}
    return [point for point in points if point.key in chosen]


def _workers(options: argparse.Namespace) -> Workers:
    from bus.excerpt import shown
    from deploy.sweep.workers import CONNECT_S, DaskCluster, LocalPool

    if options.dask:
        try:
            print(f"logging in at the Dask scheduler {shown(options.dask)} ({CONNECT_S} s at most)", flush=True)
            return DaskCluster(options.dask)
        except ImportError:
            raise ValueError("--dask needs the package distributed: run `make setup`") from None
        except (OSError, ValueError, TimeoutError) as error:
            raise ValueError(
                f"--dask {shown(options.dask)}: no scheduler answers there ({shown(error, 200)})"
            ) from None
    return LocalPool(_worker_count(options))


def _worker_count(options: argparse.Namespace) -> int:
    # A run of real processes fills the cores by itself.
    return options.workers or (1 if options.processes else os.cpu_count() or 1)


def _folder(study: Study, options: argparse.Namespace) -> Path:
    if options.out is not None:
        return Path(options.out)
    return Path("runs") / "studies" / "".join([study.name, *(mark[1:] for mark in _marks(options))])


def _marks(options: argparse.Namespace) -> list[str]:
    """The options that change results or how they are made."""
    return [f"--{word}" for word in ("quick", "processes") if getattr(options, word)]


def _run(study: Study, points: list[Point], workers: Workers | None, options: argparse.Namespace) -> int:
    from rich.console import Console

    from deploy.command import refuse
    from deploy.run_folder.claim import ClaimError
    from deploy.sweep.results import Results

    results = Results(_folder(study, options))
    with contextlib.closing(results):
        try:
            if workers is not None or results.folder.exists():
                results.claim()
        except ClaimError as error:
            return refuse("study.py", error)
        console = Console()
        if workers is not None:
            results.plan(points)
            _execute(study, points, workers, results, console, options)
        rows = results.rows()
        if not rows:
            return refuse("study.py", f"{results.folder}: no results yet")
        planned = {point.key for point in points}
        _draw(study, [row for row in rows if row["key"] in planned], results, console)
        return max(_tell_failures(rows, planned, console), _compare(rows, planned, options.compare, console))


def _execute(
    study: Study, points: list[Point], workers: Workers, results: Results, console: Console, options: argparse.Namespace
) -> None:
    from deploy.run_folder.status import meaning_of
    from deploy.sweep.workers import Execution

    done = results.done(retry_failed=options.retry_failed)
    todo = [point for point in points if point.key not in done]
    _say(console, f"{study.name}: {len(points)} runs, {len(points) - len(todo)} of them done, in {results.folder}")
    if damaged := results.damaged():
        _say(
            console,
            f"{len(damaged)} files in {results.folder / 'parts'} are damaged and count as "
            f"not run, such as {damaged[0].name}",
        )
    _warn_of_other_code(results, {point.key for point in points}, console)
    execution = Execution(workers, "processes" if options.processes else "in-process", study.series_step_s)
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
            _note(results, options, time.monotonic() - begun, count)


def _warn_of_other_code(results: Results, planned: set[str], console: Console) -> None:
    from deploy.sweep.row import code_version

    others = [row for row in results.rows() if row["key"] in planned and row.get("code") != code_version()]
    if others:
        _say(console, f"{len(others)} of the rows there come from other code (column code); remove {results.folder} "
             "to run them anew")  # fmt: skip


def _bar(console: Console) -> Any:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[runs]}/{task.fields[of]} runs"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    # Runs take minutes, so the estimate needs a long period.
    return Progress(*columns, console=console, speed_estimate_period=3600.0)


def _note(results: Results, options: argparse.Namespace, wall_s: float, runs: int) -> None:
    """Write down how the results were made; a resumed study adds up."""
    before = results.noted()
    results.note({
        "command": shlex.join(["deploy/study.py", *options.study, *_marks(options)]),
        "wall_s": round(before.get("wall_s", 0.0) + wall_s, 1),
        "runs": before.get("runs", 0) + runs,
        "workers": "Dask" if options.dask else _worker_count(options),
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
    from deploy.scenario import load
    from deploy.sweep.bounds import bounds_of
    from deploy.sweep.plots import draw

    for path in draw(study, rows, results.series(), bounds_of(load(study.scenario)), results.folder):
        _say(console, f"drawn: {path}")


def _tell_failures(rows: list[dict[str, Any]], planned: set[str], console: Console) -> int:
    from deploy.sweep.statistics import usable

    here = [row for row in rows if row["key"] in planned]
    failed = len(here) - len(usable(here))
    if failed:
        _say(console, f"{failed} of {len(here)} runs failed, see column error; --retry-failed runs them again")
    return 1 if failed else 0


def _compare(rows: list[dict[str, Any]], planned: set[str], other: Path | None, console: Console) -> int:
    if other is None:
        return 0
    from deploy.sweep.results import Results, differences

    others = [row for row in Results(other).rows() if row["key"] in planned]
    lines = differences([row for row in rows if row["key"] in planned], others)
    for line in lines:
        _say(console, line)
    _say(console, f"compared with {other}: {len(others)} runs in common, {len(lines)} differences")
    return 1 if lines or not others else 0


def _report(out: Path | None) -> int:
    from deploy.command import ROOT, refuse
    from deploy.paper.results_page import unfinished, write_report
    from deploy.sweep.results import ResultsError
    from world.own_file import ForeignFileError

    if out is None and not (ROOT / "docs" / "paper.md").is_file():
        return refuse("study.py", f"{ROOT} is no checkout, whose docs the report goes into: name a folder by --out")
    studies, docs = Path("runs") / "studies", out or ROOT / "docs"
    try:
        if (docs / "results.md").exists() and (lacking := unfinished(studies)):
            return refuse(
                "study.py", f"{docs} keeps its pages, since results are missing in {studies}: {', '.join(lacking)}. "
                "Run those studies, or write pages of what is there into another folder by --out"
            )  # fmt: skip
        pages = write_report(studies, docs)
    except (ForeignFileError, ResultsError) as error:
        return refuse("study.py", error)
    except OSError as error:
        return refuse("study.py", f"{error.filename}: can't write there: {error.strerror}")
    for page in pages:
        print(f"written: {page}")
    return 0


def _say(console: Console, words: str) -> None:
    console.print(words, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
