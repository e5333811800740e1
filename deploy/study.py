#!/usr/bin/env python3
"""Run studies and draw their results: `deploy/study.py fig7`, `deploy/study.py PATH.toml --dask HOST:8786`.

The same command goes on where an interrupted study stopped. Exit status: 0 when every run has a result, 1 when one
failed (or `--compare` found a difference), 2 for bad input (one line, before anything starts), 130 when interrupted.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from deploy.command import Parser
    from deploy.sweep.campaign import Asked
    from deploy.sweep.plan import Study
    from deploy.sweep.workers import Workers

ALSO_NEEDED: Final = ("matplotlib", "pyarrow")
REPORT: Final = "report"
"""Word for the command line, instead of a study: write docs/results.md and docs/policies.md from the results."""
BUILDINGS: Final = "buildings"
"""After `report`: write docs/buildings.md, from its table and the results."""
_MANY_RUNS: Final = 1000
"""So many take some seconds to check."""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, a_whole_number, name_of

    p = Parser(prog=name_of("study"), description="Run studies of many runs each, and draw their results.")
    p.add_argument("study", nargs="+", help="fig6, fig7, ablations, ...; a .toml file; or: report, report buildings")
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
    p.add_argument(
        "--only", action="append", default=[], metavar="KEY=VALUE",
        help="only runs with that parameter, such as seed=1 or policy=scout; repeat it for more",
    )  # fmt: skip
    p.add_argument("--compare", type=Path, metavar="DIR", help="then compare with the results there, wall times aside")
    p.add_argument("--retry-failed", action="store_true", help="run failed runs again")
    p.add_argument("--plot-only", action="store_true", help="run nothing, draw what is there")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Check everything, then run; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import INTERRUPTED, name_of, refuse, require

    require("study", ALSO_NEEDED)
    from bus.excerpt import shown
    from deploy.machine.limits import one_thread

    one_thread()
    from deploy.run_folder.claim import ClaimError
    from deploy.scenario import ScenarioError
    from deploy.sweep.campaign import carry_out, sample, select
    from deploy.sweep.plan import absent, load_study, points_of, runs_of
    from deploy.sweep.results import Results, ResultsError
    from deploy.sweep.workers import WorkersGoneError

    if options.study in ([REPORT], [REPORT, BUILDINGS]):
        return _report(options.out, buildings=options.study != [REPORT])
    try:
        _check(options)
        plans = []
        for source in options.study:
            study = load_study(source, quick=options.quick)
            Results(_folder(study, options)).check()
            if (runs := runs_of(study)) > _MANY_RUNS:
                print(f"{study.name}: checking its {runs:,} runs", flush=True)
            for path in absent(study):
                print(f"{study.name}: no runs on {shown(path)}, which is not there", flush=True)
            plans.append((study, sample(select(points_of(study), options.only), options.sample)))
        workers = None if options.plot_only else _workers(options)
    except (ScenarioError, OSError, ValueError) as error:
        return refuse("study", error)
    try:
        whole = [carry_out(study, points, workers, _folder(study, options), _asked(options)) for study, points in plans]
        return 0 if all(whole) else 1
    except (ClaimError, ResultsError) as error:
        return refuse("study", error)
    except KeyboardInterrupt:
        print(f"{name_of('study')}: interrupted; the same command goes on from here", file=sys.stderr)
        return INTERRUPTED
    except (OSError, WorkersGoneError) as error:
        print(f"{name_of('study')}: {error}; the same command goes on from here", file=sys.stderr)
        return 1
    finally:
        if workers is not None:
            workers.close()


def _check(options: argparse.Namespace) -> None:
    if REPORT in options.study:
        raise ValueError(f"{REPORT} stands alone, or before {BUILDINGS}")
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


def _workers(options: argparse.Namespace) -> Workers:
    from bus.excerpt import shown
    from deploy.command import way_to_extra
    from deploy.sweep.workers import CONNECT_S, DaskCluster, LocalPool

    if options.dask:
        try:
            print(f"logging in at the Dask scheduler {shown(options.dask)} ({CONNECT_S} s at most)", flush=True)
            return DaskCluster(options.dask)
        except ImportError:
            hint = way_to_extra()
            raise ValueError(f"--dask needs the package distributed: {hint}") from None
        except (OSError, ValueError, TimeoutError) as error:
            raise ValueError(
                f"--dask {shown(options.dask)}: no scheduler answers there ({shown(error, 200)})"
            ) from None
    return LocalPool(_worker_count(options))


def _worker_count(options: argparse.Namespace) -> int:
    # A run of real processes fills the cores by itself.
    return options.workers or (1 if options.processes else os.cpu_count() or 1)


def _asked(options: argparse.Namespace) -> Asked:
    from deploy.command import call_of
    from deploy.sweep.campaign import Asked

    return Asked(
        command=f"{call_of('study')} {shlex.join([*options.study, *_marks(options)])}",
        engine="processes" if options.processes else "in-process",
        crew="Dask" if options.dask else _worker_count(options),
        retry_failed=options.retry_failed,
        compare=options.compare,
    )


def _folder(study: Study, options: argparse.Namespace) -> Path:
    if options.out is not None:
        return Path(options.out)
    return Path("runs") / "studies" / "".join([study.name, *(mark[1:] for mark in _marks(options))])


def _marks(options: argparse.Namespace) -> list[str]:
    """The options that change results or how they are made."""
    return [f"--{word}" for word in ("quick", "processes") if getattr(options, word)]


def _report(out: Path | None, *, buildings: bool) -> int:
    from deploy.buildings.page import write_buildings
    from deploy.command import ROOT, refuse
    from deploy.paper.results_page import unfinished, write_report
    from deploy.sweep.results import ResultsError
    from world.own_file import ForeignFileError

    if out is None and not (ROOT / "docs" / "paper.md").is_file():
        return refuse("study", f"{ROOT} is no checkout, whose docs the report goes into: name a folder by --out")
    studies, docs = Path("runs") / "studies", out or ROOT / "docs"
    try:
        if buildings:
            pages = write_buildings(studies, docs)
        elif (docs / "results.md").exists() and (lacking := unfinished(studies, docs)):
            return refuse(
                "study", f"{docs} keeps its pages, since results are missing in {studies}: {', '.join(lacking)}. "
                "Run those studies, or write pages of what is there into another folder by --out"
            )  # fmt: skip
        else:
            pages = write_report(studies, docs)
    except (ForeignFileError, ResultsError) as error:
        return refuse("study", error)
    except OSError as error:
        return refuse("study", f"{error.filename}: can't write there: {error.strerror}")
    for page in pages:
        print(f"written: {page}")
    return 0


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
