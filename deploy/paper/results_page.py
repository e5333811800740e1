"""Writes docs/results.md and docs/policies.md from the results of studies; no number in them is typed by hand.

A function of the results judges each claim of the paper's text. A study without results says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from deploy.paper.claims import Verdict, fig6_claims, fig7_claims
from deploy.paper.prototype import PROTOTYPE_FIG6_S, PROTOTYPE_FIG7_S
from deploy.scenario import load
from deploy.sweep.bounds import Bounds, bounds_of
from deploy.sweep.plan import BASE, Study, Variant, load_study, points_of
from deploy.sweep.results import Results, Row, Series
from deploy.sweep.statistics import ALL, estimate, kept, ratio, usable
from world.own_file import ForeignFileError, require_own, write_whole

__all__ = ["unfinished", "write_report"]

RESULTS: Final = ("fig6", "fig7", "fig7_relay_killed", "ablations", "radio", "channel")
POLICIES: Final = ("policies", "policies_walls", "policies_trouble", "policies_plans", "policies_limits")

_WRITER: Final = "Written by `deploy/study.py report`"
"""Stands at the head of every page."""

_HEAD: Final = f"""\
# Results

{_WRITER} from the results of the studies; every number and verdict below is computed.

Our copy of the paper has no figures, so its Fig. 3 (the flowchart of behavior) and Fig. 5 (the floor plan) are missing.
Our rules and floor plan are reconstructions ([paper.md](paper.md)). What can be compared is the shape of the curves,
as the paper's text describes it; its numbers are not known. Numbers are compared with those of an independent prototype
on the same floor plan. All robots of the prototype share one map at once, while here scans travel hop by hop. Intervals
are 95 % confidence intervals of the mean (Student's t).
"""


_POLICIES_HEAD: Final = f"""\
# Two policies

{_WRITER} from the results of the studies; every number is computed.

`vds` is the paper's policy as we read it ([paper.md](paper.md)), with one rule of ours that it cannot do without behind
walls: a silent neighbor counts as far away [paper 3.7]. `scout` is our own policy on top of it ([its rules](scout.md)):
robots predict from their maps where walls will stop the radio, call for help when their chain is too short, and walk
faster where there is nothing to see. **Part of its gain is walking faster**: it walks at 2 km/h, which the paper keeps
for tracing other robots. So where the two are compared there are two numbers for `scout`, one of them at the paper's 1
km/h. Intervals are 95 % confidence intervals: of a mean by Student's t, of a ratio those of the ratio of two means over
the same seeds. The paper's rules without that rule of ours are a variant of the radio study ([results.md](results.md):
"walls block, no rule A"). Here scans count as soon as they arrive, even if their robot was cut off meanwhile
(`store_and_forward = true`); the paper's figures discard those.

A third policy, [`sortie`](sortie.md), stands on top of `scout` and leaves the network for a while on purpose. It is for
real buildings; the tables below are older than it.
"""

_WITHIN: Final = """\
Search time of all cells, mean ± standard deviation of the runs that finished, against the prototype's. *Within* means
that the two means differ by no more than the prototype's standard deviation."""


@dataclass(frozen=True)
class _Found:
    """A study and its results."""

    study: Study
    rows: list[Row]
    series: Mapping[str, Series]
    bounds: Bounds
    notes: Mapping[str, Any]


def unfinished(studies: Path) -> list[str]:
    """The studies that lack runs, such as "fig6 (12 of 90 runs)"; a page of them would pass for a whole one."""
    lacking = []
    for name in (*RESULTS, *POLICIES):
        there = {row["key"] for row in Results(studies / name).rows()}
        planned = {point.key for point in points_of(load_study(name))} if there else set()
        if not there or not planned <= there:
            lacking.append(f"{name} ({len(planned & there)} of {len(planned)} runs)" if there else name)
    return lacking


def write_report(studies: Path, docs: Path) -> list[Path]:
    """Write results.md and policies.md into `docs`, with the pictures and tables that they show in `docs`/results.

    Args:
        studies: the folder that has a folder for each study.
        docs: where the report goes.

    Raises:
        ForeignFileError: files of the user's are there; nothing is written.
        OSError: it can't be written.
    """
    for name in ("results.md", "policies.md"):
        require_own(docs / name, _WRITER)
    pictures = docs / "results"
    if not (docs / "results.md").exists() and pictures.exists() and any(pictures.iterdir()):
        raise ForeignFileError(f"{shown(pictures)}: is there already, and is not of this command: name another folder")
    return [
        _page(docs / "results.md", _HEAD, RESULTS, studies),
        _page(docs / "policies.md", _POLICIES_HEAD, POLICIES, studies),
    ]


def _page(path: Path, head: str, names: Sequence[str], studies: Path) -> Path:
    writers: dict[str, Callable[[_Found], list[str]]] = {"fig6": _fig6, "fig7": _fig7, "policies": _policies}
    lines = [head]
    docs = path.parent
    pictures = docs / "results"
    pictures.mkdir(parents=True, exist_ok=True)
    for name in names:
        study = load_study(name)
        lines += [f"## {study.title or name}", ""]
        found = _find(study, studies / name)
        if found is None:
            lines += [f"Not measured yet: `deploy/study.py {name}`.", ""]
            continue
        lines += _origin(found)
        for file in (studies / name / f"{name}.png", studies / name / f"{name}.svg", studies / name / "results.csv"):
            if file.exists():
                write_whole(pictures / (f"{name}.csv" if file.suffix == ".csv" else file.name), file.read_bytes())
        lines += [f"![{study.title or name}](results/{name}.png)", ""]
        lines += writers.get(name, _variants)(found)
    write_whole(path, "\n".join(lines).rstrip() + "\n")
    return path


def _find(study: Study, folder: Path) -> _Found | None:
    if not (folder / "results.parquet").exists():
        return None
    results = Results(folder)
    planned = {point.key for point in points_of(study)}
    rows = [row for row in results.rows() if row["key"] in planned]
    return _Found(study, rows, results.series(), bounds_of(load(study.scenario)), results.noted())


def _origin(found: _Found) -> list[str]:
    notes, failed = found.notes, len(found.rows) - len(usable(found.rows))
    line = f"{len(found.rows)} runs"
    if failed:
        line += f" ({failed} failed and left out)"
    if notes:
        line += f", by `{notes['command']}` in {notes['wall_s'] / 60:.0f} minutes on {notes['machine']}"
    return [f"{line}. All rows: [results/{found.study.name}.csv](results/{found.study.name}.csv).", ""]


def _claims(verdicts: Sequence[Verdict]) -> list[str]:
    lines = ["| the paper's text | here | verdict |", "|---|---|---|"]
    return [*lines, *(f"| {v.claim} | {v.found} | **{v.word}** |" for v in verdicts), ""]


def _fig6(found: _Found) -> list[str]:
    lines = _claims(fig6_claims(found.rows, found.series, found.study.discard))
    lines += [
        "| N | runs kept | cell | finished | search time (s) | prototype (s) | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    for robots in sorted({row["robots"] for row in usable(found.rows)}, reverse=True):
        of_fleet = [row for row in usable(found.rows) if row["robots"] == robots]
        left = kept(of_fleet, found.series, found.study.discard)
        for i, cell in enumerate(("1", "2")):
            times = [row[f"search_time_s.{cell}"] for row in left if row[f"search_time_s.{cell}"] is not None]
            ours, theirs = estimate(times), PROTOTYPE_FIG6_S.get(robots)
            relative = f"{ours.mean / theirs[i]:.2f}" if theirs and times else ""
            lines.append(
                f"| {robots} | {len(left)} of {len(of_fleet)} | {cell} | {len(times)} of {len(left)} "
                f"| {_mean(times)} | {f'{theirs[i]:.0f}' if theirs else '-'} | {relative} |"
            )
    return [*lines, "", _discard_words(found.study), ""]


def _discard_words(study: Study) -> str:
    rule = study.discard
    if rule is None:
        return "No run is discarded."
    return (
        f"A run is discarded, as the paper does, if it searches cell {rule.cell} before cell {rule.before}: by which "
        f"of them was finished first, or, if neither was, by which first reached {rule.onset_rate:.0%}. "
        "How the paper decided this is not known."
    )


def _fig7(found: _Found) -> list[str]:
    low_s, high_s = found.bounds.t_low_s
    bounds = ", ".join(f"{found.bounds.r_low_m(n):.1f} m for N = {n}" for n in (6, 9, 12))
    lines = [f"T_low = {low_s:.0f} to {high_s:.0f} s; r_low = {bounds} (`deploy/sweep/bounds.py`).", ""]
    lines += _claims(fig7_claims(found.rows, found.bounds))
    lines += [_WITHIN, ""]
    lines += [
        "| N | r_t (m) | finished | here (s) | 95 % CI | prototype (s) | ratio | within |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for robots, radius_m in sorted({(row["robots"], row["radius_m"]) for row in usable(found.rows)}):
        lines.append(_fig7_line(found.rows, robots, radius_m))
    return [*lines, ""]


def _fig7_line(rows: Sequence[Row], robots: int, radius_m: float) -> str:
    here = [row for row in usable(rows) if (row["robots"], row["radius_m"]) == (robots, radius_m)]
    times = [row[ALL] for row in here if row[ALL] is not None]
    ours, key = estimate(times), (robots, radius_m)
    theirs = PROTOTYPE_FIG7_S.get(key)
    reference = f"{theirs[0]:.0f} ± {theirs[1]:.0f}" if theirs else "none finished" if key in PROTOTYPE_FIG7_S else "-"
    relative = within = ""
    if theirs and times:
        relative = f"{ours.mean / theirs[0]:.2f}"
        within = "yes" if abs(ours.mean - theirs[0]) <= theirs[1] else "no"
    elif key in PROTOTYPE_FIG7_S:
        within = "yes" if not times and not theirs else "no"
    spread = f"{ours.mean:.0f} ± {ours.sd:.0f}" if times else "-"
    return (
        f"| {robots} | {radius_m:g} | {len(times)} of {len(here)} | {spread} | {_mean(times)} | {reference} | "
        f"{relative} | {within} |"
    )


def _variants(found: _Found) -> list[str]:
    lines = [
        "| variant | N | r_t (m) | finished | search time (s) | ratio | to | connected | what it shows |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows = usable(found.rows)
    variants = found.study.variant or (Variant(BASE),)
    for robots, radius_m in sorted({(row["robots"], row["radius_m"]) for row in rows}):
        of_fleet = [row for row in rows if (row["robots"], row["radius_m"]) == (robots, radius_m)]
        times = {v.name: _times(of_fleet, v.name, robots, radius_m) for v in variants}
        for variant in variants:
            by_seed = times[variant.name]
            if not by_seed:
                continue
            finished = [time_s for time_s in by_seed.values() if time_s is not None]
            other = variants[0].name if variant.against is None else variant.against
            relative = _ratio(by_seed, times.get(other, {}))
            connected = estimate(row["connected_fraction"] for row in of_fleet if row["variant"] == variant.name).mean
            lines.append(
                f"| {variant.name} | {robots} | {radius_m:g} | {len(finished)} of {len(by_seed)} | {_mean(finished)} "
                f"| {relative} | {other if relative else ''} | {connected:.0%} | {variant.why} |"
            )
    return [*lines, "", "Times are those of the runs that finished, ratios those of the seeds that both finished.", ""]


Times = Mapping[int, float | None]
"""Search time by seed; None for a run that did not finish."""


def _ratio(times: Times, others: Times) -> str:
    """Mean of one variant over that of another, on the seeds that both finished; empty without any."""
    pairs = [(a, b) for seed, a in times.items() if a is not None and (b := others.get(seed)) is not None]
    if not pairs or times is others:
        return ""
    found = ratio(pairs)
    return f"{found.mean:.2f}" if found.n == 1 else f"{found.mean:.2f} ± {found.half_width:.2f}"


def _times(rows: Sequence[Mapping[str, Any]], variant: str, robots: int, radius_m: float) -> dict[int, float | None]:
    fleet = variant, robots, radius_m
    return {row["seed"]: row[ALL] for row in rows if (row["variant"], row["robots"], row["radius_m"]) == fleet}


def _policies(found: _Found) -> list[str]:
    """The two numbers of every comparison, then all variants."""
    lines = [
        "| N | r_t (m) | scout / vds | at 1 km/h | share of the gain that is walking faster |",
        "|---|---|---|---|---|",
    ]
    rows = usable(found.rows)
    for robots, radius_m in sorted({(row["robots"], row["radius_m"]) for row in rows}):
        vds, scout, slow = (_times(rows, name, robots, radius_m) for name in ("vds", "scout", "scout at 1 km/h"))
        share = _share(vds, scout, slow)
        lines.append(f"| {robots} | {radius_m:g} | {_ratio(scout, vds)} | {_ratio(slow, vds)} | {share} |")
    return [*lines, "", "The share is of the seeds that all three finished.", "", *_variants(found)]


def _share(vds: Times, scout: Times, slow: Times) -> str:
    """Share of the gain of scout over vds that is lost if scout walks as slowly as vds."""
    seeds = [s for s in vds if all(times.get(s) is not None for times in (vds, scout, slow))]
    base_s, fast_s, slow_s = (math.fsum(times[s] or 0.0 for s in seeds) for times in (vds, scout, slow))
    return f"{(slow_s - fast_s) / (base_s - fast_s):.0%}" if fast_s < base_s else "-"


def _mean(times: Sequence[float]) -> str:
    """Mean and confidence interval, in seconds."""
    found = estimate(times)
    return (
        "-" if found.n == 0 else f"{found.mean:.0f}" if found.n == 1 else f"{found.mean:.0f} ± {found.half_width:.0f}"
    )
