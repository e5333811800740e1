"""Changes the sources in a copy, one place at a time, and says which changes no test notices (docs/tests.md)."""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests import ROOT
from tests.mutants.generated import generated
from tests.mutants.mutant import HELD_BY, Mutant
from tests.mutants.planted import PlantedError, planted
from tests.mutants.tree import Tree, TreeError


def chosen(options: argparse.Namespace) -> list[Mutant]:
    """The mutants that were asked for: planted, then of each file a sample."""
    mutants = planted(ROOT) if options.of in ("planted", "both") else []
    if options.of in ("generated", "both"):
        for path in HELD_BY:
            every = list(generated(ROOT, path))
            rng = random.Random(f"{options.seed}/{path}")
            sample = sorted(rng.sample(range(len(every)), round(options.share * len(every))))
            mutants += [every[k] for k in sample]
    return [mutant for mutant in mutants if options.only in mutant.what or options.only in mutant.path]


def survivors(tree: Tree, mutants: Sequence[Mutant]) -> list[Mutant]:
    """Those that their tests do not notice; says so as it goes.

    Raises:
        TreeError: tests fail without any change, so they would notice everything.
    """
    for tests in dict.fromkeys(mutant.tests for mutant in mutants):
        if not tree.passes(tests):
            raise TreeError(f"fails without any change: {' '.join(tests)}")
    left = []
    for k, mutant in enumerate(mutants, 1):
        original = (tree.path / mutant.path).read_text(encoding="utf-8")
        with tree.changed(mutant.path, mutant.text_of(original)):
            survived = tree.passes(mutant.tests)
        if survived:
            left.append(mutant)
        print(f"{k}/{len(mutants)} {'SURVIVED' if survived else 'caught'} {mutant.what}", flush=True)
    return left


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns 1 if one of the planted mutants survived; generated ones are for reading."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("of", nargs="?", choices=("planted", "generated", "both"), default="both")
    parser.add_argument("--share", type=float, default=1.0, help="of the generated mutants of each file (default: all)")
    parser.add_argument("--seed", type=int, default=1, help="of that sample")
    parser.add_argument("--only", default="", metavar="TEXT", help="mutants with TEXT in their description or file")
    options = parser.parse_args(arguments)
    try:
        mutants = chosen(options)
        with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
            left = survivors(Tree(Path(folder)), mutants)
    except (PlantedError, TreeError) as error:
        print(error, file=sys.stderr)
        return 2
    print(f"\n{len(mutants) - len(left)} of {len(mutants)} caught; survivors:")
    for mutant in left:
        print(f"- {mutant.what}")
    by_hand = {mutant.what for mutant in planted(ROOT)}
    return int(any(mutant.what in by_hand for mutant in left))


if __name__ == "__main__":
    sys.exit(main())
