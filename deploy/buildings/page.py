"""Writes docs/buildings.md from the table of the study `buildings`; no number in it is typed by hand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from deploy.buildings.claims import T100, buildings_claims, time_s
from deploy.buildings.table import Cell, cells_of, merged, read_table, write_table
from deploy.sweep.plan import load_study
from deploy.sweep.statistics import Interval, median_of, share_of
from world.own_file import require_own, write_whole

__all__ = ["write_buildings"]

NAME: Final = "buildings"
POLICIES: Final = ("sortie", "scout", "vds")
_WRITER: Final = "Written by `deploy/study.py report buildings`"

_HEAD: Final = f"""\
# Real buildings

{_WRITER} from [results/buildings.csv](results/buildings.csv); every number is computed.

Three [policies](policies.md) search seven buildings: five [plans of ours](scenarios.md), and the maps of a real
hospital (`hospital_025`, 0.25 m) and a real warehouse (`warehouse_050`, 0.5 m), which are no part of the project:
[the study](../deploy/studies/buildings.toml) leaves them out where they are absent. The base is N = 12, r_t = 15 m, a
radio that loses 18 dB at each wall (n = 3), robots that are points, exact sensors, and a limit of 3,000 s. One thing
is varied at a time: what walls do to the radio on all buildings, all else on the hospital.

* **Finished**: 99.5 % of the free floor that can be reached is known to be free at the MS. T50, T90 and T100 are when
  50, 90 and 99.5 % are. They are medians, in which a mission that does not get there counts with its limit. In
  brackets 95 % intervals: of a median by bootstrap, of the share that finished after Wilson.
* **Bound**: what no fleet can beat (`deploy/sweep/lower_bound.py`), the longer of the *walk* until one robot sees the
  last place and the *sweep*, the area over what N lidars sweep. **Chain**: the fewest robots that can see the last
  place while they keep the path to the MS, standing a metre apart or more on a grid; *none* if no such chain sees one
  of the places. **Gap left**: T100 less the bound, over the same of `scout` in that building.
* **Connected**: share of the robot-ticks with a path to the MS, mean. **Absent**: the longest time for which a robot
  had none, on purpose or not, of all missions. **Age**: the time from a scan until the MS had merged its report,
  median and 95th percentile over the reports of a mission, of which the median is shown. **Walked**: all robots
  together, median.
"""


def write_buildings(studies: Path, docs: Path) -> list[Path]:
    """Bring the table up to what the study has run, and write the page from it.

    Args:
        studies: the folder that has a folder for each study; that of this one need not be there.
        docs: where page and table go.

    Raises:
        ForeignFileError: a file of the user's is there; nothing is written.
        ResultsError: the table or the results can't be read.
        OSError: it can't be written.
    """
    page, table = docs / f"{NAME}.md", docs / "results" / f"{NAME}.csv"
    require_own(page, _WRITER)
    study = load_study(NAME)
    rows = merged(study, read_table(table), studies / NAME)
    table.parent.mkdir(parents=True, exist_ok=True)
    write_table(table, rows)
    # From the table, so that the page is the same when it is written again without the study's folder.
    write_whole(page, page_of(cells_of(study), read_table(table)).encode())
    return [table, page]


def page_of(cells: Sequence[Cell], rows: Sequence[Mapping[str, Any]]) -> str:
    """The page, of the cells that are planned and the missions that have been run."""
    by_cell = {
        cell: [r for r in rows if (r["variant"], r["scenario"]) == (cell.variant, cell.scenario)] for cell in cells
    }
    lines = [_HEAD, "## What has been run", "", *_progress(by_cell), "## What it was asked to show", ""]
    lines += ["| asked, of ten seeds | found | |", "|---|---|---|"]
    lines += [f"| {v.claim} | {v.found} | {v.word} |" for v in buildings_claims(rows)]
    lines += ["", "*Open*: seeds are missing, and those that were run do not decide it.", ""]
    for condition in dict.fromkeys(_condition(cell) for cell in cells):
        here = {cell: of_cell for cell, of_cell in by_cell.items() if of_cell and _condition(cell) == condition}
        if here:
            lines += [f"## {condition[0].upper()}{condition[1:]}", "", *_table(here), ""]
    return "\n".join(lines).rstrip() + "\n"


def _condition(cell: Cell) -> str:
    return cell.variant.partition(", ")[2]


def _policy(cell: Cell) -> str:
    return cell.variant.partition(", ")[0]


def _progress(by_cell: Mapping[Cell, Sequence[Mapping[str, Any]]]) -> list[str]:
    done, planned = sum(map(len, by_cell.values())), sum(cell.seeds for cell in by_cell)
    everything = [row for of_cell in by_cell.values() for row in of_cell]
    wall_h = math.fsum(row["wall_s"] for row in everything) / 3600.0
    codes = dict.fromkeys(row["code"] for row in everything)
    words = (
        f"{done} of {planned} missions, in {wall_h:.1f} hours of one core beside other work, by sources with digest "
        f"{', '.join(f'`{code}`' for code in codes) or '-'}. The table has the seeds that were run, of those that are "
        "planned; `deploy/study.py buildings` runs the others, with `--only` some of them."
    )
    lines = [words, ""]
    buildings = list(dict.fromkeys(cell.scenario for cell in by_cell))
    lines += ["| | " + " | ".join(f"`{name}`" for name in buildings) + " |", "|---" * (len(buildings) + 1) + "|"]
    for variant in dict.fromkeys(cell.variant for cell in by_cell):
        counts = {c.scenario: f"{len(rows)} of {c.seeds}" for c, rows in by_cell.items() if c.variant == variant}
        lines.append(f"| {variant} | " + " | ".join(counts.get(name, "-") for name in buildings) + " |")
    return [*lines, ""]


def _table(by_cell: Mapping[Cell, Sequence[Mapping[str, Any]]]) -> list[str]:
    head = (
        "| building | policy | finished | T50 (s) | T90 (s) | T100 (s) | bound (s): walk, sweep | chain | gap left "
        "| connected | absent (s) | age (s) | walked (km) |"
    )
    lines = [head, "|---" * 13 + "|"]
    for building in dict.fromkeys(cell.scenario for cell in by_cell):
        of_policy = {_policy(cell): rows for cell, rows in by_cell.items() if cell.scenario == building}
        reference = of_policy.get("scout", ())
        lines += [_line(building, name, of_policy[name], reference) for name in POLICIES if name in of_policy]
    return lines


def _line(building: str, policy: str, rows: Sequence[Mapping[str, Any]], reference: Sequence[Mapping[str, Any]]) -> str:
    first = rows[0]
    bound_s = max(first["bound.walk_s"], first["bound.sweep_s"])
    times = " | ".join(_times(rows, f"known_free.t{share}_s") for share in (50, 90, 100))
    ages = ", ".join(_median(row[f"information_age.{which}_s"] for row in rows) for which in ("median", "p95"))
    connected = math.fsum(row["connected_fraction"] for row in rows) / len(rows)
    walked_km = median(row["walked_m"] / 1000.0 for row in rows)
    return (
        f"| `{building}` | {policy} | {_finished(rows)} | {times} | **{bound_s:.0f}**: {first['bound.walk_s']:.0f}, "
        f"{first['bound.sweep_s']:.0f} | {_whole(first['bound.chain'])} | {_gap(rows, reference, bound_s)} "
        f"| {connected:.1%} | {max(row['longest_absence_s'] for row in rows):.0f} | {ages} | {walked_km:.1f} |"
    )


def _finished(rows: Sequence[Mapping[str, Any]]) -> str:
    done = sum(row[T100] is not None for row in rows)
    share = share_of(done, len(rows))
    return f"{done} of {len(rows)} [{share.low:.0%}, {share.high:.0%}]"


def _times(rows: Sequence[Mapping[str, Any]], time: str) -> str:
    limit_s = max(row["duration_s"] for row in rows)
    found = median_of([time_s(row, time) for row in rows])
    middle = f"> {limit_s:.0f}" if found.value >= limit_s else f"{found.value:.0f}"
    return middle + _ends(found)


def _ends(found: Interval) -> str:
    return "" if found.low == found.high else f" [{found.low:.0f}, {found.high:.0f}]"


def _gap(rows: Sequence[Mapping[str, Any]], reference: Sequence[Mapping[str, Any]], bound_s: float) -> str:
    """Of two medians; only where at least half of the missions of both finished, since else one is not known."""
    pairs = [(median(time_s(row) for row in some), some[0]["duration_s"]) for some in (rows, reference) if some]
    if len(pairs) < 2 or any(time_s_ >= limit_s for time_s_, limit_s in pairs):
        return "-"
    return f"{(pairs[0][0] - bound_s) / (pairs[1][0] - bound_s):.2f}"


def _median(values: Iterable[float | None]) -> str:
    """A run whose value is not known, since too many reports never came, counts as later than all others."""
    found = median(math.inf if value is None else value for value in values)
    return f"{found:.1f}" if math.isfinite(found) else "never"


def _whole(value: float | None) -> str:
    return "none" if value is None else f"{value:.0f}"
