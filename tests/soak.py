"""Soak: a day of simulated time on real processes with a fault all the time, and what their memory comes to.

    python -m tests.soak [--hours 24] [--robots 3] [--seed 1]

The radius is so short that the search never ends, and a search robot whose chain is taut tries another frontier again
and again, so robots move all the time. Faults are drawn from the seed and scheduled: a run in one process beside it
must give the same digest. Robot 1 is never killed, and the station in the first quarter only, so that there are old
processes to look at. There is no recording: its file grows with the run, by design.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any, Final

import numpy as np

from deploy.emulation import SCRIPT, Emulation
from deploy.json_file import read_object
from deploy.scenario import load
from world.terms import TICK_S

RADIUS_M: Final = 8.0
EVERY_S: Final = 30.0
"""From one fault to the next."""
SHARES: Final = {"start": 0.05, "middle": 0.5, "end": 0.95}
"""Of the run, at which memory is looked at; every simulated hour, too, for the log."""
GROWTH_KB: Final = 12_000
"""Most that a process may have grown between middle and end: what it keeps of each fault, and slack of the heap."""
STATION: Final = "station"
OLD: Final = ("launcher", "world", "medium", STATION, "robot/1")
"""Processes that must be the same ones in the middle and at the end."""


@dataclass(frozen=True)
class Memory:
    """Memory of a process, in kB."""

    pid: int
    rss_kb: int
    pss_kb: int
    """Pages that processes share are divided among them."""


Sample = Mapping[str, Memory]
"""By name of the process."""


@dataclass(frozen=True)
class Outcome:
    """One soak."""

    faults: int
    simulated_s: float
    wall_s: float
    samples: Mapping[str, Sample]
    """At `SHARES` of the run."""
    problems: tuple[str, ...]


def plan(seed: int, seconds: float, robots: int) -> list[str]:
    """The faults of a soak: one every `EVERY_S`, never on a node that is away."""
    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 97])))
    faults: list[str] = []
    away_until_s: dict[str, float] = {}
    for k in range(1, int(seconds / EVERY_S)):
        at_s = k * EVERY_S
        lasting_s = round(float(draw.uniform(2.0, 1.8 * EVERY_S)), 1)
        verb = str(draw.choice(["kill", "restart", "pause", "jam", "loss"]))
        if verb == "jam":
            a, b = draw.choice(robots + 1, 2, replace=False).tolist()
            faults.append(f"jam:{a},{b}@{at_s:g}+{lasting_s:g}")
        elif verb == "loss":
            faults.append(f"loss:{draw.uniform(0.05, 0.5):.2f}@{at_s:g}+{lasting_s:g}")
        else:
            young = [str(robot) for robot in range(2, robots + 1)]
            nodes = young + (["1", STATION] if verb == "pause" else [STATION] * (at_s < seconds / 4))
            here = [node for node in nodes if away_until_s.get(node, 0.0) <= at_s]
            if not here:
                continue
            node = str(draw.choice(here))
            away_until_s[node] = at_s + lasting_s
            if verb != "kill":
                faults.append(f"{verb}:{node}@{at_s:g}+{lasting_s:g}")
                continue
            # Dead for good, until somebody brings a new one.
            faults += [f"kill:{node}@{at_s:g}", f"restart:{node}@{at_s + lasting_s / 2:.1f}+{lasting_s / 2:.1f}"]
    return faults


def soak(
    seed: int, seconds: float, folder: Path, *, robots: int = 3, tell: Callable[[str], object] = lambda _: None
) -> Outcome:
    """Run real processes under faults, and the same run in one process beside them; tells what did not hold."""
    faults = plan(seed, seconds, robots)
    # Whether a starved machine is slow is not the question here.
    options = {"robots": robots, "radius_m": RADIUS_M, "seed": seed, "duration_s": seconds, "deadlines.hang_s": 20.0}
    asked = folder / "asked.toml"
    asked.write_text(load("three_cells", {**options, "fault": faults}).to_toml(), encoding="utf-8")
    begun = time.monotonic()
    samples: dict[str, Sample] = {}
    command = [
        sys.executable, str(SCRIPT), "--scenario", str(asked), "--in-process", "--no-recording", "-q",
        "--owner", str(os.getpid()), "--out", str(folder / "replay"),
    ]  # fmt: skip
    # In a session of its own like the other: the kernel shares out processors among sessions.
    with Popen(command, stdin=DEVNULL, start_new_session=True) as replay:
        try:
            # Held, a run takes its steps as fast as it can; at this speed it is not over before it is held.
            with Emulation(asked, folder / "run", speed=1.0) as run:
                for name, at_s in _stops(seconds):
                    _run_to(run, at_s)
                    sample = _memory(run.pids)
                    tell(f"{at_s / 3600:.2f} h, {time.monotonic() - begun:.0f} s wall: {_row(sample)}")
                    if name:
                        samples[name] = sample
                run.command("speed max")
                run.wait_until(lambda: _trimmed(run).over, 600.0)
                summary = run.summary
                wall_s = time.monotonic() - begun
            tell(f"over after {wall_s:.0f} s wall")
            replay.wait()
        finally:
            replay.kill()
    again = read_object(folder / "replay" / "summary.json")
    problems = [*grown(samples), *_broken(summary, again, len(faults))]
    return Outcome(len(faults), summary["simulated_s"], wall_s, samples, tuple(problems))


def _stops(seconds: float) -> Iterator[tuple[str, float]]:
    """When to look at the memory, and the name of the moment if it has one."""
    named = {round(share * seconds, 1): name for name, share in SHARES.items()}
    hours = {hour * 3600.0 for hour in range(1, int(seconds / 3600.0))}
    for at_s in sorted({*named, *hours}):
        yield named.get(at_s, ""), at_s


def _run_to(run: Emulation, at_s: float) -> None:
    """Let the run go on to a moment, and hold it there."""
    left = round(at_s / TICK_S) - run.command("hold")["tick"]
    if left > 0:
        run.command(f"step {left}")
    run.wait_until(lambda: _trimmed(run).simulated_s >= at_s - TICK_S, 24 * 3600.0)


def _trimmed(run: Emulation) -> Emulation:
    """The run without its old snapshots: this process is to stay small, too."""
    del run.snapshots[:-1]
    return run


def _memory(pids: Mapping[str, int]) -> Sample:
    """Memory of every process that is there."""
    sample: dict[str, Memory] = {}
    for name, pid in pids.items():
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue  # dead, or away by schedule
        kb = {line.split()[0]: int(line.split()[1]) for line in lines[1:]}
        sample[name] = Memory(pid, kb["Rss:"], kb["Pss:"])
    return sample


def _row(sample: Sample) -> str:
    return ", ".join(f"{name} {m.rss_kb / 1000:.1f} ({m.pss_kb / 1000:.1f})" for name, m in sample.items())


def grown(samples: Mapping[str, Sample]) -> Iterator[str]:
    middle, end = samples["middle"], samples["end"]
    for name in OLD:
        if name not in middle or name not in end or middle[name].pid != end[name].pid:
            yield f"{name} is not the process that it was"
    for name in middle.keys() & end.keys():
        for kind in ("rss_kb", "pss_kb"):
            before, after = getattr(middle[name], kind), getattr(end[name], kind)
            if after - before > GROWTH_KB:
                yield f"{name} grew from {before} to {after} kB ({kind.removesuffix('_kb')})"


def _broken(summary: Mapping[str, Any], again: Mapping[str, Any], faults: int) -> Iterator[str]:
    for wrong, words in (
        (summary["status"] != "time_limit", f"status {summary['status']}"),
        (summary["failures"], f"failures {summary['failures']}"),
        (summary["wall_clock_faults"] != 0, f"{summary['wall_clock_faults']} left out beyond the deadline"),
        (len(summary["faults"]) != faults, f"{len(summary['faults'])} of {faults} faults acted"),
        (summary["scan_reports"]["lost"] != 0, f"{summary['scan_reports']['lost']} scan reports lost"),
        (summary["trace_sha256"] != again["trace_sha256"], "another trace than in one process"),
    ):
        if wrong:
            yield words


def main() -> int:
    """Run the soak; returns 1 if anything did not hold."""
    parser = argparse.ArgumentParser(description="a day of simulated time under faults, and what memory comes to")
    parser.add_argument("--hours", type=float, default=24.0, help="simulated hours")
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()

    def tell(words: str) -> None:
        print(words, flush=True)

    tell("RSS (PSS) in MB:")
    with tempfile.TemporaryDirectory(prefix="vds-soak-") as folder:
        o = soak(options.seed, options.hours * 3600.0, Path(folder), robots=options.robots, tell=tell)
    tell(f"\n| process | {' | '.join(o.samples)} |\n|---|{'---|' * len(o.samples)}")
    for name in o.samples["start"]:
        cells = [s.get(name) for s in o.samples.values()]
        tell(f"| {name} | {' | '.join('away' if m is None else _row({'': m}).strip() for m in cells)} |")
    words = "; ".join(o.problems) or "all held"
    tell(f"\n{o.faults} faults in {o.simulated_s / 3600:g} h simulated ({o.wall_s:.0f} s wall): {words}")
    return int(bool(o.problems))


if __name__ == "__main__":
    sys.exit(main())
