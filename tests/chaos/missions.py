"""Long missions: a random fault every 10 simulated seconds, on real processes, and what must hold nevertheless.

The faults are drawn from the seed and scheduled, so a mission can be run again to the bit.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from deploy.emulation import Emulation
from deploy.scenario import load
from deploy.simulation import Simulation

ROBOTS: Final = 12
RADIUS_M: Final = 6.0
"""Short enough that the search does not end before 1,000 s."""
EVERY_S: Final = 10.0
MOST_DOWN: Final = 2
GROWTH: Final = 1.25
"""Highest ratio of a process's memory at the end to that after the first fifth of the run (its map has grown)."""
SLACK_KB: Final = 16_000


@dataclass(frozen=True)
class Outcome:
    """One run of chaos."""

    seed: int
    faults: int
    simulated_s: float
    wall_s: float
    slowest_tick_ms: float
    problems: tuple[str, ...]


def plan(seed: int, seconds: float) -> list[str]:
    """The faults of a run: at most two robots are down at a time."""
    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 99])))
    faults: list[str] = []
    down: list[tuple[float, int]] = []
    """(until, robot)"""
    for k in range(1, int(seconds / EVERY_S)):
        at_s = k * EVERY_S
        down = [(until, robot) for until, robot in down if until > at_s]
        verbs = ["jam", "loss"] + ["restart", "pause"] * (len(down) < MOST_DOWN)
        verb = str(draw.choice(verbs))
        lasting_s = round(float(draw.uniform(2.0, 18.0)), 1)
        robot = int(draw.choice([r for r in range(1, ROBOTS + 1) if r not in {r for _, r in down}]))
        other = robot % ROBOTS + 1
        target = {"jam": f"{robot},{other}", "loss": f"{draw.uniform(0.05, 0.5):.2f}"}.get(verb, str(robot))
        faults.append(f"{verb}:{target}@{at_s:g}+{lasting_s:g}")
        if verb in ("restart", "pause"):
            down.append((at_s + lasting_s, robot))
    return faults


def chaos(seed: int, seconds: float, folder: Path) -> Outcome:
    """Run chaos in real processes and once more in this one; tells what did not hold."""
    faults = plan(seed, seconds)
    options = {"robots": ROBOTS, "radius_m": RADIUS_M, "seed": seed, "duration_s": seconds}
    begun = time.monotonic()
    memory: dict[str, list[int]] = {name: [] for name in ("launcher", "world", "medium", "station")}
    problems: list[str] = []
    with Emulation("three_cells", folder, faults=faults, **options) as run:
        for tenth in range(2, 10):
            run.wait_for(tenth * seconds / 10, 600.0)
            for name in memory:
                memory[name].append(_resident_kb(run.pids[name]))
        summary, pids = run.summary, run.pids
        left = [name for name, pid in pids.items() if _is_ours(pid)]
        away = max(int((s.present == 0).sum()) for s in run.snapshots)
    wall_s = time.monotonic() - begun
    again = Simulation(load("three_cells", {**options, "fault": faults})).run()
    for name, seen in memory.items():
        held = [kilobytes for kilobytes in seen if kilobytes]
        if len(held) < 2:
            problems.append(f"{name} was gone before its memory could be looked at twice")
        elif held[-1] > held[0] * GROWTH + SLACK_KB:
            problems.append(f"{name} grew from {held[0]} to {held[-1]} kB")
    for wrong, words in (
        (summary["status"] not in ("time_limit", "searched"), f"status {summary['status']}"),
        (summary["failures"], f"failures {summary['failures']}"),
        (summary["wall_clock_faults"] != 0, f"{summary['wall_clock_faults']} left out beyond the deadline"),
        (len(summary["recoveries"]) != len(faults), f"{len(summary['recoveries'])} of {len(faults)} faults acted"),
        (away > MOST_DOWN, f"{away} robots down at once"),
        (summary["scan_reports"]["lost"] != 0, f"{summary['scan_reports']['lost']} scan reports lost"),
        (any(v["scan_reports"]["lost"] for v in summary["recoveries"]), "a fault lost scan reports"),
        (left, f"processes left behind: {left}"),
        (summary["trace_sha256"] != again.trace_sha256, "another trace when run again"),
    ):
        if wrong:
            problems.append(words)
    return Outcome(seed, len(faults), summary["simulated_s"], wall_s, summary["tick_ms"]["p99"], tuple(problems))


def _resident_kb(pid: int) -> int:
    """0 of a process that is gone: the run may end sooner than who watches it comes to the processor."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS:")), 0)


def _is_ours(pid: int) -> bool:
    """The process is there, and is one of a run: a pid may have been given away again."""
    try:
        return b"vds " in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def missions(count: int, seconds: float) -> bool:
    """Run the missions of seeds 1 to `count`, and print a line each; whether all held."""
    held = True
    for seed in range(1, count + 1):
        with tempfile.TemporaryDirectory(prefix="vds-chaos-") as folder:
            o = chaos(seed, seconds, Path(folder))
        words = "; ".join(o.problems) or "all held"
        print(
            f"seed {seed}: {o.faults} faults in {o.simulated_s:.0f} s simulated ({o.wall_s:.0f} s wall), "
            f"99 % of the ticks within {o.slowest_tick_ms:.0f} ms: {words}",
            flush=True,
        )
        held = held and not o.problems
    return held
