"""Fuzzes every decoder, the four cores and their shells: `make fuzz`, or `python -m tests.fuzz --inputs 1000 --seed 1`.

An input is a valid message (or text, or file) that was changed. Decoders may refuse it in their own way, in few words;
nothing else may come of it. Cores and shells take what decoders let through, and nothing at all may come of that.
Each batch of inputs has random numbers of its own: `--batch 1234` repeats one.
"""

from __future__ import annotations

import argparse
import logging
import random
import resource
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

from tests import ROOT
from tests.fuzzing.decoders import ways_in
from tests.fuzzing.hostile import HostileRun
from tests.fuzzing.mutations import mutated
from tests.fuzzing.shells import TICKS, medium_goes_on, node_goes_on, world_goes_on

BATCH: Final = 250
SHELL_MESSAGES: Final = 30
MOST_BYTES: Final = 400_000_000
"""Most memory by which one batch may raise that of this process."""
ADDRESS_SPACE: Final = 8 * 2**30


class Fuzzer:
    """Counts the outcomes of inputs."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self.inputs: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.findings: list[str] = []
        self.slowest_s: Counter[str] = Counter()

    def batch(self, number: int) -> None:
        """Run one batch; a finding ends it."""
        rng = random.Random(f"{self._seed}/{number}")
        kind = rng.choices(("decoders", "cores", "shells", "files"), (80, 17, 2, 1))[0]
        before, since_s = _memory(), time.process_time()
        try:
            for inputs, refused in getattr(self, f"_{kind}")(rng):
                self.inputs[kind] += inputs
                self.refused[kind] += refused
            assert _memory() - before < MOST_BYTES, f"{_memory() - before} bytes more"
        except Exception:
            self.findings.append(f"batch {number} ({kind}):\n{traceback.format_exc()}")
            print(self.findings[-1], file=sys.stderr, flush=True)
        self.slowest_s[kind] = max(self.slowest_s[kind], time.process_time() - since_s)

    def _decoders(self, rng: random.Random) -> Iterator[tuple[int, int]]:
        yield from self._ways_in(rng, BATCH, slow=False)

    def _files(self, rng: random.Random) -> Iterator[tuple[int, int]]:
        yield from self._ways_in(rng, BATCH, slow=True)

    @staticmethod
    def _ways_in(rng: random.Random, inputs: int, *, slow: bool) -> Iterator[tuple[int, int]]:
        ways = [way for way in ways_in() if way.slow == slow]
        for _ in range(inputs):
            way = rng.choice(ways)
            data = mutated(rng, rng.choice(way.samples), way.samples)
            try:
                yield 1, not way.try_on(data)
            except Exception as error:
                error.add_note(f"{way.name}: {data[:200]!r}")
                raise

    @staticmethod
    def _cores(rng: random.Random) -> Iterator[tuple[int, int]]:
        inputs = 0
        while inputs < BATCH:
            run = HostileRun(rng)
            for _ in range(80):
                if not run.tick():
                    break
            inputs += run.inputs
            yield run.inputs, run.refused

    @staticmethod
    def _shells(rng: random.Random) -> Iterator[tuple[int, int]]:
        for act in medium_goes_on, world_goes_on, node_goes_on:
            act(rng, SHELL_MESSAGES)
            yield TICKS * SHELL_MESSAGES, 0


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main() -> int:
    """Fuzz; returns 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--batch", type=int, help="only this one")
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    fuzzer, since_s, number = Fuzzer(options.seed), time.monotonic(), options.batch or 0
    ways_in()
    start = _memory()
    while True:
        fuzzer.batch(number)
        number += 1
        if options.batch is not None or fuzzer.inputs.total() >= options.inputs or len(fuzzer.findings) >= 20:
            break
        if number % 200 == 0:
            print(f"{fuzzer.inputs.total()} inputs, {len(fuzzer.findings)} findings", flush=True)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    print(f"{datetime.now(UTC):%Y-%m-%d}, commit {commit.strip()}: {' '.join(sys.argv[1:])}")
    for kind, inputs in fuzzer.inputs.most_common():
        slowest = f"slowest batch {fuzzer.slowest_s[kind]:.1f} s"
        print(f"{kind:>10}: {inputs:9,} inputs, {fuzzer.refused[kind]:9,} refused, {slowest}")
    print(
        f"{fuzzer.inputs.total():,} inputs, {len(fuzzer.findings)} findings, {time.monotonic() - since_s:,.0f} s, "
        f"memory {start / 1e6:,.0f} MB at the start and {_memory() / 1e6:,.0f} MB at most"
    )
    return 1 if fuzzer.findings else 0


if __name__ == "__main__":
    sys.exit(main())
