"""One short run with its trouble, from start to verdict, and what of it is reported."""

from __future__ import annotations

import random
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.chaos.ending import problems
from tests.chaos.short_run import ShortRun
from tests.chaos.small_disk import small_disk
from tests.chaos.troubles import KINDS

__all__ = ["Outcome", "kind_of", "outcome_of"]

_DISK_KB: Final = 50_000


@dataclass(frozen=True)
class Outcome:
    """One short run."""

    seed: int
    kind: str
    moment: str
    status: int | None
    ended: str | None
    """What the summary says; None without one."""
    met: bool
    """Whether the trouble came before the end."""
    wall_s: float
    expected: tuple[str, ...]
    """What was expected and did not hold."""


def kind_of(seed: int) -> str:
    """Every kind has its turn."""
    return list(KINDS)[seed % len(KINDS)]


def outcome_of(seed: int, kind: str) -> Outcome:
    """Make one kind of trouble for one run."""
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="c-", dir="/tmp") as folder:
        run = ShortRun(seed, random.Random(f"{kind} {seed}"), Path(folder))
        with small_disk(run.out.parent, _DISK_KB):
            found = problems(run, KINDS[kind](run))
            summary = run.summary()
    ended = None if summary is None else summary["status"]
    wall_s = time.monotonic() - begun_s
    return Outcome(seed, kind, run.moment, run.process.returncode, ended, run.acted, wall_s, tuple(found))
