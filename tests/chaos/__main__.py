"""Chaos: `python -m tests.chaos [--runs 200] [--seed 1] [--only KIND] [--missions 5] [--seconds 1000]`.

Short runs first, each with one kind of trouble (`tests/chaos/troubles.py`). Kind, victims and moments follow from the
run's seed, though not to the millisecond: trouble comes by wall time. Then long missions with a scheduled fault every
10 s (`tests/chaos/missions.py`).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Final

from tests.chaos.missions import missions
from tests.chaos.outcome import Outcome, kind_of, outcome_of
from tests.chaos.troubles import KINDS

AT_ONCE: Final = 2


def short_runs(runs: int, first: int, only: str | None) -> bool:
    """Make trouble for many runs, and print what did not hold and a table of what became of them; whether all held."""
    begun_s = time.monotonic()
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(AT_ONCE, mp_context=get_context("spawn")) as pool:
        seeds = range(first, first + runs)
        for o in pool.map(outcome_of, seeds, [only or kind_of(seed) for seed in seeds]):
            outcomes.append(o)
            for words in o.expected:
                print(f"seed {o.seed}, {o.kind} {o.moment}: expected {words}")
            if o.expected:
                print(f"    again: make chaos ARGS='--runs 1 --seed {o.seed} --only {o.kind}'", flush=True)
    print("| trouble | runs | met in time | ended with status | did not end as documented |\n|---|---|---|---|---|")
    for kind in KINDS:
        of_kind = [o for o in outcomes if o.kind == kind]
        ends = Counter(f"{o.status} ({o.ended or 'no summary'})" for o in of_kind)
        told = ", ".join(f"{end}: {count}" for end, count in sorted(ends.items()))
        if of_kind:
            met, bad = sum(o.met for o in of_kind), sum(bool(o.expected) for o in of_kind)
            print(f"| `{kind}` | {len(of_kind)} | {met} | {told} | {bad} |")
    bad = sum(bool(o.expected) for o in outcomes)
    shortest_s, longest_s = min(o.wall_s for o in outcomes), max(o.wall_s for o in outcomes)
    print(
        f"{len(outcomes)} runs in {time.monotonic() - begun_s:.0f} s, of {shortest_s:.1f} to {longest_s:.1f} s each: "
        f"{bad or 'none'} did not end as documented",
        flush=True,
    )
    return bad == 0


def main() -> int:
    """Make the chaos that is asked for; returns 1 if anything did not hold."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description="trouble for runs of real processes")
    parser.add_argument("--runs", type=int, default=200, help="how many short runs")
    parser.add_argument("--seed", type=int, default=1, help="of the first of them")
    parser.add_argument("--only", choices=KINDS, metavar="KIND", help=f"one kind of trouble: {', '.join(KINDS)}")
    parser.add_argument("--missions", type=int, help="how many long missions (default: 5, none with --only)")
    parser.add_argument("--seconds", type=float, default=1000.0, help="simulated seconds of each mission")
    options = parser.parse_args()
    long = options.missions if options.missions is not None else 0 if options.only else 5
    held = [short_runs(options.runs, options.seed, options.only)] if options.runs else []
    held += [missions(long, options.seconds)] if long else []
    return int(not all(held))


if __name__ == "__main__":
    sys.exit(main())
