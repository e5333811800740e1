"""The page about two runs: what differs, curves over each other, maps side by side."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Final

from deploy.page.html import card, number, page, percent, seconds, table
from deploy.page.run_page import (
    connected_card,
    faults_card,
    hops_card,
    map_card,
    mean_rate,
    repeat_card,
    search_card,
    status,
    victims_card,
)  # fmt: skip
from deploy.run_folder.reader import Run
from monitor_station.config import cell_title

__all__ = ["comparison_page"]


def _radio_mb(run: Run) -> float | None:
    sent = run.group("frames").get("bytes")
    return sent / 1e6 if isinstance(sent, int) else None


_Value = Callable[[Run], object]
_COMPARED: Final[tuple[tuple[str, _Value, Callable[[object], str]], ...]] = (
    ("status", lambda run: run.summary["status"], number),
    ("scenario", lambda run: run.summary.get("scenario"), number),
    ("robots", lambda run: run.summary.get("robots"), number),
    ("radius, m", lambda run: run.summary.get("radius_m"), number),
    ("seed", lambda run: run.summary.get("seed"), number),
    ("policy", lambda run: None if run.scenario is None else run.scenario.tables.policy, number),
    ("searched", mean_rate, lambda value: percent(value, 1)),
    ("all searched after", lambda run: run.group("search_time_s").get("all"), seconds),
    ("victims found", lambda run: run.group("victims").get("found"), number),
    ("connected", lambda run: run.summary.get("connected_fraction"), lambda value: percent(value, 2)),
    ("most hops", lambda run: run.summary.get("max_hops"), number),
    ("faults", lambda run: len(run.rows("faults")), number),
    ("faults recovered", lambda run: sum(row.get("recovered") is True for row in run.rows("recoveries")), number),
    ("scan reports made", lambda run: run.group("scan_reports").get("made"), number),
    ("scan reports merged", lambda run: run.group("scan_reports").get("merged"), number),
    ("frames sent", lambda run: run.group("frames").get("sent"), number),
    ("radio, MB", _radio_mb, number),
    ("simulated", lambda run: run.summary.get("simulated_s"), seconds),
    ("real-time factor", lambda run: run.summary.get("real_time_factor"), number),
    ("tick, median ms", lambda run: run.group("tick_ms").get("p50"), number),
)


def _difference_card(a: Run, b: Run) -> str:
    rows = []
    for name, value, show in _COMPARED:
        first, second = value(a), value(b)
        rows.append([name, show(first), show(second), _difference(first, second, show)])
    for name in dict.fromkeys([*a.group("search_time_s"), *b.group("search_time_s")]):
        if name != "all":
            first, second = a.group("search_time_s").get(name), b.group("search_time_s").get(name)
            rows.append([
                f"{escape(cell_title(name))} searched after", seconds(first), seconds(second),
                _difference(first, second, seconds),
            ])  # fmt: skip
    same = a.summary.get("trace_sha256") == b.summary.get("trace_sha256") is not None
    rows.append(["same to the bit", "", "", "yes" if same else "no"])
    return card("What differs", table(["", "A", "B", "B \u2212 A"], rows, numbers=(1, 2, 3)), "wide")


def _difference(first: object, second: object, show: Callable[[object], str]) -> str:
    numbers = (int, float)
    if isinstance(first, numbers) and isinstance(second, numbers):
        gap = second - first
        text = show(round(gap, 6))
        return "same" if gap == 0 else f"+{text}" if gap > 0 else text.replace("-", "\u2212")
    return "same" if first == second else "differs"


def comparison_page(a: Run, b: Run) -> str:
    """The page about two runs: what differs, curves over each other, maps side by side."""
    head = (
        f"<h1>{escape(a.name)} and {escape(b.name)}</h1>"
        f"<p>A: {escape(str(a.path))} {status(a)}<br>B: {escape(str(b.path))} {status(b)}</p>"
    )
    runs = [a, b]
    body = [
        head,
        '<div class="cards">',
        _difference_card(a, b),
        search_card(runs),
        victims_card(runs),
        connected_card(runs),
        hops_card(runs),
        *(map_card(run, f"Map of {letter}") for letter, run in zip("AB", runs, strict=True)),
        *(faults_card(run, f"Faults of {letter}") for letter, run in zip("AB", runs, strict=True)),
        *(repeat_card(run, f"Repeat {letter}") for letter, run in zip("AB", runs, strict=True)),
        "</div>",
    ]
    return page(f"{a.name} and {b.name}", "two", body)
