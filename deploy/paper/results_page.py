"""Writes docs/results.md and docs/policies.md from the results of studies; no number in them is typed by hand.

A function of the results judges each claim of the paper's text. A study without results says so. Results are those of
runs/studies, else the tables beside the pages, which the last report left there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from deploy.json_file import read_object
from deploy.paper.claims import Verdict, fig6_claims, fig7_claims
from deploy.scenario import load
from deploy.sweep.bounds import Bounds, bounds_of
from deploy.sweep.plan import BASE, Study, Variant, load_study, points_of
from deploy.sweep.results import Results, Row, Series, read_csv, read_series
from deploy.sweep.statistics import Interval, censored, censored_s, kept, ratio, usable
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
as the paper's text describes it; its numbers are not known. The text has words only, so the rules by which a claim
holds, holds in part or does not hold are ours; they stand beside each verdict.

A run that did not finish is left out nowhere: it counts with its time limit. Times are means of min(T, limit) with 95 %
bootstrap intervals, beside the number of runs that finished. Variants are compared seed by seed.
"""


_POLICIES_HEAD: Final = f"""\
# Two policies

{_WRITER} from the results of the studies; every number is computed.

`vds` is the paper's policy as we read it ([paper.md](paper.md)), with one rule of ours that it cannot do without behind
walls: a silent neighbor counts as far away [paper 3.7]. `scout` is our own policy on top of it ([its rules](scout.md)):
robots predict from their maps where walls will stop the radio, call for help when their chain is too short, and walk
faster where there is nothing to see. **Part of its gain is walking faster**: it walks at 2 km/h, which the paper keeps
for tracing other robots. So where the two are compared there are two numbers for `scout`, one of them at the paper's 1
km/h. A run that did not finish counts with its time limit; intervals are 95 % bootstrap intervals, of ratios over the
same seeds. The paper's rules without that rule of ours are a variant of the radio study ([results.md](results.md):
"walls block, no rule A"). Here scans count as soon as they arrive, even if their robot was cut off meanwhile
(`store_and_forward = true`); the paper's figures discard those.

A third policy, [`sortie`](sortie.md), stands on top of `scout` and leaves the network for a while on purpose. It is for
real buildings; the tables below are older than it.
"""


@dataclass(frozen=True)
class _Found:
    """A study and its results."""

    study: Study
    rows: list[Row]
    series: Mapping[str, Series]
    bounds: Bounds
    notes: Mapping[str, Any]


def unfinished(studies: Path, docs: Path) -> list[str]:
    """The studies that lack runs, such as "fig6 (12 of 90 runs)", or without a table though the pages show them."""
    shows = "".join(path.read_text(encoding="utf-8") for path in docs.glob("*.md"))
    lacking = []
    for name in (*RESULTS, *POLICIES):
        there = {row["key"] for row in Results(studies / name).rows()}
        planned = {point.key for point in points_of(load_study(name))} if there else set()
        if there and not planned <= there:
            lacking.append(f"{name} ({len(planned & there)} of {len(planned)} runs)")
        elif not there and f"(results/{name}.csv)" in shows and not (docs / "results" / f"{name}.csv").exists():
            lacking.append(name)
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
        found = _find(study, studies / name, pictures)
        if found is None:
            lines += [f"Not measured yet: `deploy/study.py {name}`.", ""]
            continue
        lines += _origin(found)
        lines += [f"![{study.title or name}](results/{name}.png)", ""]
        lines += writers.get(name, _variants)(found)
    write_whole(path, "\n".join(lines).rstrip() + "\n")
    return path


def _find(study: Study, folder: Path, kept_in: Path) -> _Found | None:
    """The results of a study: those of its folder, which are then kept beside the pages, else those kept there."""
    name = study.name
    table, series, notes = (kept_in / f"{name}{ending}" for ending in (".csv", ".series.parquet", ".json"))
    results = Results(folder)
    if (folder / "results.parquet").exists():
        planned = {point.key for point in points_of(study)}
        rows = [row for row in results.rows() if row["key"] in planned]
        copies = {"results.csv": table, "study.json": notes, f"{name}.png": kept_in / f"{name}.png"}
        copies[f"{name}.svg"] = kept_in / f"{name}.svg"
        if study.discard is not None:
            copies["series.parquet"] = series
        for file, copy in copies.items():
            if (folder / file).exists():
                write_whole(copy, (folder / file).read_bytes())
        found, noted = results.series(), results.noted()
    elif table.exists():
        rows, found = read_csv(table), read_series(series)
        noted = read_object(notes) if notes.exists() else {}
    else:
        return None
    fleets = {row["robots"] for row in rows} if study.plot == "search_time" else ()
    bounds = _bounds(study.scenario, tuple(sorted(fleets)))
    if not (folder / "results.parquet").exists() and (found or study.plot != "search_rate"):
        from deploy.sweep.plots import draw  # late: Matplotlib takes a second

        draw(study, rows, found, bounds, kept_in)
    return _Found(study, rows, found, bounds, noted)


@functools.cache
def _bounds(scenario: str, fleets: tuple[int, ...]) -> Bounds:
    """They take seconds, and several studies are about one scenario."""
    return bounds_of(load(scenario), fleets)


def _origin(found: _Found) -> list[str]:
    notes, failed = found.notes, len(found.rows) - len(usable(found.rows))
    line = f"{len(found.rows)} runs"
    if failed:
        line += f" ({failed} failed and left out)"
    if notes:
        line += f", by `{notes['command']}` in {notes['wall_s'] / 60:.0f} minutes on {notes['machine']}"
    return [f"{line}. All rows: [results/{found.study.name}.csv](results/{found.study.name}.csv).", ""]


def _claims(verdicts: Sequence[Verdict]) -> list[str]:
    lines = ["| the paper's text | here | verdict | by this rule |", "|---|---|---|---|"]
    return [*lines, *(f"| {v.claim} | {v.found} | **{v.word}** | {v.rule} |" for v in verdicts), ""]


def _fig6(found: _Found) -> list[str]:
    lines = _claims(fig6_claims(found.rows, found.series, found.study.discard))
    lines += ["| N | runs | cell | finished | search time (s) | searched at the end |", "|---|---|---|---|---|---|"]
    for robots in sorted({row["robots"] for row in usable(found.rows)}, reverse=True):
        of_fleet = [row for row in usable(found.rows) if row["robots"] == robots]
        left = kept(of_fleet, found.series, found.study.discard)
        for name, rows in ((f"{len(left)} kept", left), (f"all {len(of_fleet)}", of_fleet)):
            lines += [_fig6_line(robots, name, rows, cell) for cell in ("1", "2") if rows]
    return [*lines, "", _discard_words(found), ""]


def _fig6_line(robots: int, name: str, rows: Sequence[Mapping[str, Any]], cell: str) -> str:
    times = censored(rows, f"search_time_s.{cell}")
    rate = sum(row[f"search_rate.{cell}"] for row in rows) / len(rows)
    return f"| {robots} | {name} | {cell} | {times.finished} of {times.runs} | {_seconds(times.mean_s)} | {rate:.0%} |"


def _discard_words(found: _Found) -> str:
    rule = found.study.discard
    if rule is None:
        return "No run is discarded."
    words = (
        f"A run is discarded, as the paper does, if it searches cell {rule.cell} before cell {rule.before}: by which "
        f"of them was finished first, or, if neither was, by which first reached {rule.onset_rate:.0%}. "
        "How the paper decided this is not known."
    )
    unknown = sum(row["key"] not in found.series for row in usable(found.rows))
    return words + (
        f" The time series of {unknown} of these runs were not kept, so those of them that finished neither cell all "
        "count as kept. The picture was drawn when they were there."
        if unknown
        else ""
    )


def _fig7(found: _Found) -> list[str]:
    bounds, fleets = found.bounds, sorted({row["robots"] for row in usable(found.rows)})
    radio = ", ".join(f"{bounds.radio_m[n]:.1f} m for N = {n}" for n in fleets)
    corridor = ", ".join(f"{bounds.corridor_m(n):.1f} m" for n in fleets)
    words = (
        f"T_low = {bounds.t_low_s:.0f} s. r_low = {radio}: the least r_t with which a chain of N robots can see every "
        "place by the study's radio, which passes walls. Along the corridors, with links of r_in, it would be "
        f"{corridor}; that is probably what the paper means (`deploy/sweep/bounds.py`)."
    )
    lines = [words, ""]
    lines += _claims(fig7_claims(found.rows, found.bounds))
    lines += ["| N | r_t (m) | finished | search time (s) |", "|---|---|---|---|"]
    for robots, radius_m in sorted({(row["robots"], row["radius_m"]) for row in usable(found.rows)}):
        here = [row for row in usable(found.rows) if (row["robots"], row["radius_m"]) == (robots, radius_m)]
        times = censored(here)
        lines.append(f"| {robots} | {radius_m:g} | {times.finished} of {times.runs} | {_seconds(times.mean_s)} |")
    return [*lines, ""]


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
            here = [row for row in of_fleet if row["variant"] == variant.name]
            if not here:
                continue
            found_times = censored(here)
            other = variants[0].name if variant.against is None else variant.against
            relative = _ratio(times[variant.name], times.get(other, {}))
            connected = sum(row["connected_fraction"] for row in here) / len(here)
            lines.append(
                f"| {variant.name} | {robots} | {radius_m:g} | {found_times.finished} of {found_times.runs} "
                f"| {_seconds(found_times.mean_s)} | {relative} | {other if relative else ''} | {connected:.0%} "
                f"| {variant.why} |"
            )
    return [*lines, "", "Times are means of min(T, limit), ratios those of the seeds that both ran.", ""]


Times = Mapping[int, float]
"""min(T, limit) by seed."""


def _ratio(times: Times, others: Times) -> str:
    """Mean of one variant over that of another, on the seeds that both ran; empty without any."""
    pairs = [(time_s, others[seed]) for seed, time_s in times.items() if seed in others]
    if not pairs or times is others:
        return ""
    found = ratio(pairs)
    return f"{found.value:.2f}" if len(pairs) == 1 else f"{found.value:.2f} ({found.low:.2f} to {found.high:.2f})"


def _times(rows: Sequence[Mapping[str, Any]], variant: str, robots: int, radius_m: float) -> dict[int, float]:
    fleet = variant, robots, radius_m
    return {row["seed"]: censored_s(row) for row in rows if (row["variant"], row["robots"], row["radius_m"]) == fleet}


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
    return [*lines, "", "The share is of the seeds that all three ran.", "", *_variants(found)]


def _share(vds: Times, scout: Times, slow: Times) -> str:
    """Share of the gain of scout over vds that is lost if scout walks as slowly as vds."""
    seeds = sorted(vds.keys() & scout.keys() & slow.keys())
    base_s, fast_s, slow_s = (math.fsum(times[s] for s in seeds) for times in (vds, scout, slow))
    return f"{(slow_s - fast_s) / (base_s - fast_s):.0%}" if fast_s < base_s else "-"


def _seconds(mean_s: Interval) -> str:
    """Mean and interval."""
    if mean_s.low == mean_s.high:
        return f"{mean_s.value:.0f}"
    return f"{mean_s.value:.0f} ({mean_s.low:.0f} to {mean_s.high:.0f})"
