"""Whole missions against what the procedure promises, too long for the test suite: `make acceptance`.

Prints a section of Markdown for each: the promise, the result, and a verdict. Exit status 1 if any fails.
`python -m tests.acceptance missions digests` runs those only; `--seeds 2` is a quick look at the first four.
The sections on policies judge studies, which have seeds of their own and go on where they were interrupted.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported; a run is one thread

from deploy.buildings.claims import ASKED, buildings_claims  # noqa: E402 - after the lines above
from deploy.scenario import load  # noqa: E402
from deploy.simulation import Simulation  # noqa: E402
from deploy.sweep.campaign import select  # noqa: E402
from deploy.sweep.plan import absent, load_study, points_of  # noqa: E402
from deploy.sweep.results import Results  # noqa: E402
from deploy.sweep.row import code_version  # noqa: E402
from deploy.sweep.statistics import ALL  # noqa: E402
from tests import ROOT  # noqa: E402

Run = tuple[str, Mapping[str, Any]]
"""A scenario and its overrides."""


class Outcome(NamedTuple):
    """The outcome of a run."""

    seed: int
    status: str
    search_time_s: float | None
    digest: str
    recoveries: list[dict[str, Any]]


def run(task: Run) -> Outcome:
    """One run in this process."""
    name, overrides = task
    result = Simulation(load(name, overrides)).run()
    world, station = result.finals["world"], result.finals["station"]
    return Outcome(
        int(overrides["seed"]),
        world["status"],
        station["search_time_s"]["all"],
        result.trace_sha256,
        world["recoveries"],
    )


def run_all(tasks: Iterable[Run]) -> list[Outcome]:
    """All runs, in order, on all cores."""
    with ProcessPoolExecutor() as pool:
        return list(pool.map(run, tasks))


def times_of(outcomes: list[Outcome]) -> list[float]:
    return [o.search_time_s for o in outcomes if o.search_time_s is not None]


def spread(times: list[float]) -> str:
    if not times:
        return "-"
    deviation = statistics.stdev(times) if len(times) > 1 else 0.0
    return f"{statistics.mean(times):.0f} ± {deviation:.0f} s"


def verdict(ok: bool) -> str:
    return "met" if ok else "**not met**"


def missions(seeds: int) -> Iterator[str | bool]:
    """Nine robots at r_t = 20 m search all cells in 19 of 20 seeds, near the prototype's mean."""
    prototype_s = 589.0
    outcomes = run_all(("three_cells", {"seed": s}) for s in range(1, seeds + 1))
    times = times_of(outcomes)
    yield "## Nine robots, r_t = 20 m\n"
    yield f"All cells searched in {len(times)} of {seeds} seeds (at least 19 of 20 asked): "
    ok = len(times) >= 0.95 * seeds
    yield f"{verdict(ok)}.\n"
    yield ok
    ratio = statistics.mean(times) / prototype_s if times else 0.0
    close = abs(ratio - 1.0) <= 0.15
    yield f"Search time {spread(times)}, {ratio:.2f} of the prototype's 589 ± 114 s (0.85 to 1.15 asked): "
    yield f"{verdict(close)}.\n"
    yield (
        "Seeds: " + ", ".join("-" if o.search_time_s is None else f"{o.search_time_s:.0f}" for o in outcomes) + " s.\n"
    )


def digests(seeds: int) -> Iterator[str | bool]:
    """Five full missions of each policy have the same trace digest in one process and in many."""
    count = min(5, seeds)
    yield "## One process or many\n"
    behind_walls = {"policy": "scout", "radius_m": 15.0, "radio.model": "disk_los"}
    in_trouble = behind_walls | {
        "policy": "sortie", "body_radius_m": 0.25, "pose_noise_m": 0.05, "lidar.noise_m": 0.05,
        "radio.bandwidth_bytes_s": 20_000.0, "radio.burst_share": 0.05,
    }  # fmt: skip
    factors: dict[str, list[float]] = {
        "`vds`, r_t = 20 m, disk": [],
        "`scout`, r_t = 15 m, walls block": [],
        "`sortie`, r_t = 15 m, walls block, with bodies, noise, 20 kB/s and bursts": [],
    }
    yield "| mission, N = 9 | seed | in one process | in many | real-time factor of the many, with recording |\n"
    yield "|---|---|---|---|---|\n"
    for (name, measured), overrides in zip(factors.items(), ({}, behind_walls, in_trouble), strict=True):
        outcomes = run_all(("three_cells", {"seed": s, **overrides}) for s in range(1, count + 1))
        for outcome in outcomes:
            options = [f"--set={key}={value}" for key, value in overrides.items()]
            summary = in_processes("--seed", str(outcome.seed), *options)
            measured.append(float(summary["real_time_factor"]))
            many = str(summary["trace_sha256"])
            yield f"| {name} | {outcome.seed} | `{outcome.digest[:12]}` | `{many[:12]}` | {measured[-1]:.1f} |\n"
            yield many == outcome.digest
    fast = statistics.median(factors["`vds`, r_t = 20 m, disk"])
    yield f"\nReal-time factor of `vds`, median: {fast:.1f} (at least 10 asked): {verdict(fast >= 10.0)}.\n"
    yield fast >= 10.0


def pace(_: int) -> Iterator[str | bool]:
    """In processes scout is at most 15 % slower than vds, both without walls and behind walls."""
    yield "## Real-time factor of `scout`\n"
    yield "| N = 9, r_t = 20 m, 100 s as real processes, in turn | vds | scout | ratio of the medians | |\n"
    yield "|---|---|---|---|---|\n"
    for model in ("disk", "disk_los"):
        factors: dict[str, list[float]] = {"vds": [], "scout": []}
        for _round in range(5):
            for policy, measured in factors.items():
                options = ("--no-recording", "--duration", "100", "--policy", policy, f"--set=radio.model={model}")
                measured.append(float(in_processes(*options)["real_time_factor"]))
        ratio = statistics.median(factors["scout"]) / statistics.median(factors["vds"])
        shown = " | ".join(", ".join(f"{factor:.1f}" for factor in each) for each in factors.values())
        yield f"| {model} | {shown} | {ratio:.2f} | {verdict(ratio >= 0.85)} |\n"
        yield ratio >= 0.85
    yield "\nAt least 0.85 asked.\n"


def figure_7(_: int) -> Iterator[str | bool]:
    """Twenty runs of Fig. 7, chosen at random, give the same rows as real processes."""
    yield "## Fig. 7, twenty runs as real processes\n"
    study("fig7")
    command = [sys.executable, str(ROOT / "deploy/study.py"), "fig7", "--processes", "--sample", "20"]
    done = subprocess.run(
        [*command, "--compare", "runs/studies/fig7"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    yield "Every column but wall times, against the rows of one process: "
    yield f"{(done.stdout.splitlines() or ['nothing'])[-1]}: {verdict(done.returncode == 0)}.\n"
    yield done.returncode == 0


def compiled(_: int) -> Iterator[str | bool]:
    """The compiled form has the same traces, ten seeds of two minutes."""
    yield "## Compiled or not\n"
    subprocess.run(["make", "-s", "compiled"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    plain, fast = (traces(root) for root in (ROOT, ROOT / "build/compiled"))
    same = sum(a == b for a, b in zip(plain, fast, strict=True))
    yield f"The same digest for {same} of {len(plain)} seeds of N = 9, r_t = 20 m, 120 s each: "
    yield f"{verdict(same == len(plain))}.\n"
    yield same == len(plain)


def traces(root: Path) -> list[str]:
    """Digests of ten seeds, by the program at `root`."""
    script = """
from deploy.scenario import load
from deploy.simulation import Simulation
for seed in range(1, 11):
    print(Simulation(load("three_cells", {"seed": seed, "duration_s": 120.0})).run().trace_sha256)
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=root, check=True, capture_output=True, text=True)
    return done.stdout.split()


def in_processes(*options: str) -> dict[str, Any]:
    """The summary of a run of real processes."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "deploy/run_local.py"), "--out", folder, "-q", *options]
        subprocess.run(command, check=True)
        summary: dict[str, Any] = json.loads((Path(folder) / "summary.json").read_text())
    return summary


def cell(robots: int, radius_m: float, seeds: int, **more: Any) -> list[Outcome]:
    fixed = {"robots": robots, "radius_m": radius_m, "duration_s": 3000.0, **more}
    return run_all(("three_cells", {**fixed, "seed": s}) for s in range(1, seeds + 1))


Rows = list[dict[str, Any]]


def study(name: str, *only: str) -> Rows:
    """Rows of a study as it is planned now, after its missing runs; failed runs finished no cell.

    Args:
        name: of the study.
        only: the runs that have these parameters, as `deploy/study.py --only` takes them; all if there is none.

    Raises:
        RuntimeError: a row comes from other code.
    """
    command = [sys.executable, str(ROOT / "deploy/study.py"), name, *(f"--only={text}" for text in only)]
    subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    rows = {row["key"]: row for row in Results(ROOT / "runs/studies" / name).rows()}
    planned = [rows[point.key] for point in select(points_of(load_study(name)), only)]
    other = sum(row["code"] != code_version() for row in planned)
    if other:
        raise RuntimeError(f"{other} rows in runs/studies/{name} come from other code: remove that folder")
    return planned


def fleets(rows: Rows) -> Iterator[tuple[int, float, dict[str, Rows]]]:
    """N, r_t, and the rows of each variant with them."""
    for robots, radius in dict.fromkeys((row["robots"], row["radius_m"]) for row in rows):
        here = [row for row in rows if (row["robots"], row["radius_m"]) == (robots, radius)]
        yield robots, radius, {v: [r for r in here if r["variant"] == v] for v in {r["variant"] for r in here}}


def search_times(rows: Rows) -> list[float]:
    return [row[ALL] for row in rows if row.get(ALL) is not None]


def finished(rows: Rows) -> str:
    return f"{spread(search_times(rows))}, {len(search_times(rows))} of {len(rows)}"


def policies_disk(_: int) -> Iterator[str | bool]:
    """On disk, scout needs at most 0.75 of vds in four cells, and always finishes."""
    yield "## Policy `scout` against the paper's rules, disk\n"
    yield "| N / r_t | vds | scout | scout, walking at 1 km/h | ratio | ratio at 1 km/h | |\n"
    yield "|---|---|---|---|---|---|---|\n"
    for robots, radius, by in fleets(study("policies")):
        names = ("vds", "scout", "scout at 1 km/h")
        means = [statistics.fmean(search_times(by[name]) or [math.nan]) for name in names]
        ok = means[1] / means[0] <= 0.75 and len(search_times(by["scout"])) == len(by["scout"])
        yield f"| {robots} / {radius:g} | " + " | ".join(finished(by[name]) for name in names)
        yield f" | {means[1] / means[0]:.2f} | {means[2] / means[0]:.2f} | {verdict(ok)} |\n"
        yield ok
    yield "\nSearch time, and how many finished within 3,000 s. Asked: a first ratio of at most 0.75, all of `scout`.\n"


def policies_walls(_: int) -> Iterator[str | bool]:
    """Behind walls scout finishes in (nearly) all seeds."""
    yield "## Policy `scout` behind walls\n"
    yield "| N / r_t | disk_los | | log_distance, n = 2.2, 18 dB a wall | |\n|---|---|---|---|---|\n"
    for robots, radius, by in fleets(study("policies_walls")):
        asked = {"scout, walls block": 0.95 if (robots, radius) == (6, 20.0) else 1.0, "scout, 18 dB a wall": 0.95}
        yield f"| {robots} / {radius:g} "
        for name, share in asked.items():
            ok = len(search_times(by[name])) >= share * len(by[name])
            yield f"| {finished(by[name])} | {verdict(ok)} "
            yield ok
        yield "|\n"
    yield "\nAsked: all with disk_los (19 of 20 at 6 / 20), 19 of 20 with log_distance.\n"


def policies_trouble(_: int) -> Iterator[str | bool]:
    """Loss, shadowing, a misjudged wall and a dead relay, N = 12, r_t = 15 m behind walls."""
    yield "## Policy `scout` in trouble: N = 12, r_t = 15 m, behind walls\n"
    yield "| trouble | search time, finished | | seeds with an orphan | last orphan back | |\n"
    yield "|---|---|---|---|---|---|\n"
    for _, _, by in fleets(study("policies_trouble")):
        for name, rows in sorted(by.items()):
            ok = len(search_times(rows)) >= 0.9 * len(rows)
            yield f"| {name} | {finished(rows)} | {verdict(ok)} "
            yield ok
            orphaned = [
                [r["recovered_s"] for r in json.loads(row.get("recoveries") or "[]") if r["orphaned"]] for row in rows
            ]
            back = [recovered_s for seed in orphaned for recovered_s in seed]
            seeds = sum(bool(seed) for seed in orphaned)
            if "killed" not in name:
                yield "| | | |\n"
                continue
            healed = bool(back) and None not in back and max(back) <= 90.0
            last = "none" if not back else "never" if None in back else f"{max(back):.1f} s"
            yield f"| {seeds} of {len(rows)} | {last} | {verdict(healed)} |\n"
            yield healed
    yield "\nAsked: 18 of 20 finish, and the last orphan is back within 90 s.\n"


def buildings(_: int) -> Iterator[str | bool]:
    """On real buildings and plans like them sortie finishes, and noise, bodies and bandwidth cost little."""
    yield "## Buildings: ten seeds each, N = 12, r_t = 15 m\n"
    gone = [Path(path).stem for path in absent(load_study("buildings"))]
    rows: Rows = []
    for variant, places in ASKED.items():
        there = [f"scenario={place}" for place in places if place not in gone]
        rows += study("buildings", f'variant="{variant}"', *there) if there else []
    yield "| asked | found | |\n|---|---|---|\n"
    for claim in buildings_claims(rows):
        word = "its map is not there" if claim.holds is None else verdict(claim.holds)
        yield f"| {claim.claim} | {claim.found} | {word} |\n"
        yield claim.holds is not False
    yield "\nT100 is when 99.5 % of the free floor is known to be free at the MS; docs/buildings.md has the study.\n"


ORPHAN_RADII_M = (20.0, 18.0, 15.0, 12.0)
"""r_t = 20 m, and shorter ones that are tried while too few seeds have an orphan."""


def dead_relay(seeds: int) -> Iterator[str | bool]:
    """N = 12, a relay in the middle of the chain is killed at 120 s; every orphan is back within 60 s."""
    yield "## A dead relay: N = 12, `kill:relay:mid@120`\n"
    yield "| r_t | seeds with an orphan | orphans | back after (median, longest) | seeds with all back within 60 s "
    yield "| all cells searched | search time |\n|---|---|---|---|---|---|---|\n"
    for radius in ORPHAN_RADII_M:
        outcomes = cell(12, radius, seeds, duration_s=4000.0, fault=["kill:relay:mid@120"])
        orphans = [[o for r in outcome.recoveries for o in r["orphans"]] for outcome in outcomes]
        # An orphan that was struck itself is not waited for.
        back = [[o["recovered_s"] for o in seed if not o["departed"]] for seed in orphans]
        healed = sum(all(t is not None and t <= 60.0 for t in seed) for seed in back)
        known = [t for seed in back for t in seed if t is not None]
        done = times_of(outcomes)
        cut_off = sum(bool(seed) for seed in orphans)
        after = f"{statistics.median(known):.1f} s, {max(known):.1f} s" if known else "-"
        yield f"| {radius:g} m | {cut_off} of {seeds} | {sum(map(len, orphans))} | {after} | {healed} of {seeds} "
        yield f"| {len(done)} of {seeds} | {spread(done)} |\n"
        yield healed == seeds
        yield len(done) == seeds
        if cut_off >= 0.75 * seeds:
            yield f"\nAn orphan in at least 15 of 20 seeds (asked): {verdict(True)} at r_t = {radius:g} m.\n"
            yield True
            return
    yield f"\nAn orphan in at least 15 of 20 seeds (asked): {verdict(False)}.\n"
    yield False


SECTIONS: dict[str, Callable[[int], Iterator[str | bool]]] = {
    "missions": missions,
    "digests": digests,
    "pace": pace,
    "dead_relay": dead_relay,
    "compiled": compiled,
    "figure_7": figure_7,
    "policies_disk": policies_disk,
    "policies_walls": policies_walls,
    "policies_trouble": policies_trouble,
    "buildings": buildings,
}


def main() -> int:
    parser = argparse.ArgumentParser(description="Whole missions against what is promised.")
    parser.add_argument("sections", nargs="*", help=f"of {', '.join(SECTIONS)} (default: all)")
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    unknown = [name for name in options.sections if name not in SECTIONS]
    if unknown or options.seeds < 1:
        print(f"acceptance.py: no section {', '.join(unknown)}, or no seeds", file=sys.stderr)
        return 2
    print(f"# Acceptance\n\n{os.cpu_count()} cores, Python {platform.python_version()}, {options.seeds} seeds.\n")
    good = True
    for name in options.sections or SECTIONS:
        for part in SECTIONS[name](options.seeds):
            if isinstance(part, bool):
                good &= part
            else:
                print(part, end="", flush=True)
        print(flush=True)
    print("All met." if good else "**Not all met.**")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
