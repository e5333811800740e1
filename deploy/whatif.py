#!/usr/bin/env python3
"""Which robot can a mission not afford to lose, and when? `deploy/whatif.py three_cells --robots 9`.

The same command goes on where an interrupted one stopped. Exit status: 0 when every failure was tried, 1 when a branch
failed, 2 for bad input (one line, before anything starts), 130 when interrupted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

if TYPE_CHECKING:
    from deploy.command import Parser
    from deploy.criticality.analysis import Analysis
    from deploy.scenario import Scenario

ALSO_NEEDED: Final = ("matplotlib", "pyarrow")
_AWAY_S: Final = 10.0
_DIGITS: Final = 8


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, a_number, a_whole_number, name_of
    from deploy.scenario_options import add_scenario_options

    p = Parser(
        prog=name_of("whatif"), description="Let every robot of a mission fail at every moment, each in a branch."
    )
    p.add_argument(
        "mission", nargs="?", default="three_cells", metavar="RUN_DIR|SCENARIO",
        help="a run's folder, with all that befell it; a scenario's name, a .toml file or a map's .yaml",
    )  # fmt: skip
    add_scenario_options(p)
    p.add_argument("--verb", default="kill", metavar="VERB", help="what befalls a robot: kill, pause or restart")
    p.add_argument("--away", type=a_number, metavar="S", help="how long a pause or restart lasts (default 10)")
    p.add_argument("--every", type=a_number, default=10.0, metavar="S", help="time between failures (default 10)")
    p.add_argument("--horizon", type=a_number, default=90.0, metavar="S", help="watch a failure so long (default 90)")
    p.add_argument("--to-end", action="store_true", help="run each branch to its end, and tell the search time lost")
    p.add_argument("--workers", type=a_whole_number, metavar="N", help="branches at once (default: one per core)")
    p.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default: one in runs/whatif)")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Check everything, then run; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import INTERRUPTED, name_of, refuse, require

    require("whatif", ALSO_NEEDED)
    from deploy.branching import BranchError
    from deploy.criticality.results import ResultsError
    from deploy.run_folder.claim import ClaimError

    try:
        analysis = _analysis(options)
        failed = analysis.carry_out(options.out or _folder(analysis))
    except (ClaimError, ResultsError) as error:
        return refuse("whatif", f"--out {error}")
    except ValueError as error:
        return refuse("whatif", error)
    except BranchError as error:
        print(f"{name_of('whatif')}: {error}; the same command goes on from here", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{name_of('whatif')}: {error}; the same command goes on from here", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"{name_of('whatif')}: interrupted; the same command goes on from here", file=sys.stderr)
        return INTERRUPTED
    if failed:
        print(f"whatif.py: {failed} branches failed; the same command tries them again", file=sys.stderr)
    return 1 if failed else 0


def _analysis(options: argparse.Namespace) -> Analysis:
    """What is asked for.

    Raises:
        ValueError: something is wrong with it; one line.
    """
    from bus.excerpt import shown
    from deploy.criticality.analysis import Analysis
    from deploy.criticality.failure import Failure, Verb
    from world.terms import TICK_S, tick_of

    if options.verb not in get_args(Verb):
        raise ValueError(f"--verb {shown(options.verb)}: expected {shown(', '.join(get_args(Verb)))}")
    if options.verb == "kill" and options.away is not None:
        raise ValueError("--away is for pause and restart: kill is for good")
    if options.workers is not None and options.workers < 1:
        raise ValueError(f"--workers {options.workers:d}: at least 1")
    away_s = None if options.verb == "kill" else _AWAY_S if options.away is None else options.away
    for name, value in {"every": options.every, "horizon": options.horizon, "away": away_s}.items():
        if value is not None and not (TICK_S <= value <= 1e6 and abs(tick_of(value) * TICK_S - value) < 1e-6):
            raise ValueError(f"--{name} {value:g}: a multiple of {TICK_S:g} s up to 1e6 s is needed")
    failure = Failure(options.verb, away_s, options.horizon, options.to_end)
    return Analysis(_scenario(options), failure, options.every, options.workers or os.cpu_count() or 1)


def _scenario(options: argparse.Namespace) -> Scenario:
    from deploy.run_folder.baseline import faults_of
    from deploy.scenario import load
    from deploy.scenario_options import overrides_of

    overrides = overrides_of(options)
    run = Path(options.mission)
    if not run.is_dir():
        return load(options.mission, overrides)
    overrides["fault"] = faults_of(run) + options.fault
    return load(run / "scenario.toml", overrides, own_faults=False)


def _folder(analysis: Analysis) -> Path:
    """A folder of this analysis alone, so that the same command finds it again."""
    text = json.dumps(analysis.asked, sort_keys=True) + analysis.scenario.to_toml()
    digest = hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
    return Path("runs") / "whatif" / f"{analysis.scenario.name}-{analysis.failure.verb}-{digest}"


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
