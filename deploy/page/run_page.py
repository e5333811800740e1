"""The page about one run, and the cards that it shares with the page about two."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from html import escape
from typing import Any, Final

from deploy.command import call_of
from deploy.page.charts import Bar, Line, Mark, bar_chart, legend, line_chart
from deploy.page.html import card, milliseconds, number, page, percent, say, seconds, table
from deploy.page.map_picture import MAP_KEY, map_picture
from deploy.run_folder.reader import Run
from deploy.run_folder.status import meaning_of
from monitor_station.config import cell_title

__all__ = ["repeat_command", "report_page"]

_LONGEST_LIST: Final = 300
_SHOWN_EVENTS: Final = ("mission", "victim", "fault", "recovery", "drop", "link")
_FEW_MARKS: Final = 40


def report_page(run: Run) -> str:
    """The page about one run."""
    summary = run.summary
    what = f"{say(summary.get('scenario'))}, {say(summary.get('robots'))} robots, seed {say(summary.get('seed'))}"
    head = (
        f"<h1>{escape(what)}</h1><p>{status(run)} <span class='soft'>after {seconds(summary.get('simulated_s'))} "
        f"simulated in {seconds(summary.get('wall_s'))}, transmission radius "
        f"{number(summary.get('radius_m'))} m, run folder {escape(run.name)}</span></p>"
    )
    body = [
        head,
        _tiles(run),
        _trouble(run),
        '<div class="cards"><div class="column">',
        map_card(run),
        _cells_card(run),
        '</div><div class="column">',
        search_card([run]),
        connected_card([run]),
        hops_card([run]),
        "</div>",
        faults_card(run),
        _counts_card(run),
        _ticks_card(run),
        _events_card(run),
        repeat_card(run),
        "</div>",
    ]
    return page(f"Run {run.name}: {what}", "one", body)


def status(run: Run) -> str:
    meaning = meaning_of(run.summary["status"])
    return f'<span class="badge {meaning.kind}">{escape(meaning.words)}</span>'


def mean_rate(run: Run) -> float | None:
    rates = [rate for rate in run.group("search_rate").values() if isinstance(rate, int | float)]
    return sum(rates) / len(rates) if rates else None


def _tiles(run: Run) -> str:
    summary = run.summary
    search_time, victims, verdicts = run.group("search_time_s"), run.group("victims"), run.rows("recoveries")
    affected = [row for row in verdicts if row.get("recovered") != "not affected"]
    healed = sum(row.get("recovered") is True for row in affected)
    tick_ms = run.group("tick_ms")
    tiles = [
        ("Searched", percent(mean_rate(run)), f"all after {seconds(search_time.get('all'))}"),
        ("Victims found", f"{number(victims.get('found'))} of {number(victims.get('placed'))}", ""),
        ("Connected", percent(summary.get("connected_fraction"), 2), _apart(run)),
        ("Most hops", number(summary.get("max_hops")), "to the monitor station"),
        ("Faults", str(len(run.rows("faults"))), f"{len(affected)} cut robots off, {healed} recovered"),
        ("Real-time factor", number(summary.get("real_time_factor")), "simulated over wall time"),
        ("Tick", milliseconds(tick_ms.get("p50")), f"median; 99 % below {milliseconds(tick_ms.get('p99'))}"),
        ("Simulated", seconds(summary.get("simulated_s")), f"{number(summary.get('ticks'))} ticks"),
    ]
    items = "".join(
        f'<div class="tile"><dt>{name}</dt><dd>{value}{f"<small>{note}</small>" if note else ""}</dd></div>'
        for name, value, note in tiles
    )
    return f'<dl class="tiles">{items}</dl>'


def _apart(run: Run) -> str:
    """What the share of connected robot time is of, and the part of the rest that was planned."""
    absences = run.group("planned_absences")
    away = f"; {percent(absences.get('fraction'), 2)} away as planned" if absences.get("count") else ""
    return f"of all robot time{away}"


def _trouble(run: Run) -> str:
    """What failed, if anything did."""
    failures = run.summary.get("failures")
    told = [*failures] if isinstance(failures, list) else []
    if run.summary.get("why"):
        told.insert(0, run.summary["why"])
    if not told:
        return ""
    return card("What failed", "".join(f"<pre>{escape(str(words))}</pre>" for words in told), "wide bad-news")


def map_card(run: Run, title: str = "Map at the end") -> str:
    picture = map_picture(run)
    if picture is None:
        return card(title, "<p class='soft'>The run left no map.</p>")
    shapes = {
        "search": '<circle class="search" cx="11" cy="9" r="6"/>',
        "relay": '<circle class="relay" cx="11" cy="9" r="6"/>',
        "hop": '<path class="hop" d="M2 9H20"/>',
        "station": '<rect class="station" x="4" y="2" width="14" height="14"/>',
        "gone": '<path class="gone" d="M5 3l12 12m0-12l-12 12"/>',
        "found": '<path class="found" d="M11 2l6 13h-12z"/>',
        "missed": '<path class="missed" d="M11 2l6 13h-12z"/>',
    }
    items = "".join(
        f'<li><svg class="swatch" viewBox="0 0 22 18" aria-hidden="true">{shapes[kind]}</svg>{words}</li>'
        for kind, words in MAP_KEY
    )
    return card(title, f'{picture}<ul class="legend key">{items}</ul>')


def _cells_card(run: Run) -> str:
    times = run.group("search_time_s")
    rows = [
        [escape(cell_title(name)), percent(rate, 1), seconds(times.get(name))]
        for name, rate in run.group("search_rate").items()
    ]
    return card("Search cells", table(["cell", "searched", "all of it after"], rows, numbers=(1, 2)))


def search_card(runs: Sequence[Run]) -> str:
    lines = [
        _line(runs, which, cell_title(name), rates, i, percent(run.group("search_rate").get(name)))
        for which, run in enumerate(runs)
        for i, (name, rates) in enumerate(run.search_rates.items())
    ]
    chart = line_chart(
        "Searched share of each cell",
        "Share of each cell that is searched, over simulated time.",
        lines,
        y_name="searched",
        y_max=1.0,
        y_text=lambda share: f"{share:.0%}",
        marks=_marks(runs),
    )
    return card("Search rate", chart + legend(lines))


def victims_card(runs: Sequence[Run]) -> str:
    what = "Victims that the monitor station knows, over simulated time."
    return _counted(runs, "Victims", what, "victims", [("victims found", "victims_found", 3)])


def connected_card(runs: Sequence[Run]) -> str:
    what = "Robots that take part and robots that have a route to the monitor station, over simulated time."
    lines = [("robots that take part", "robots_present", 5), ("with a route to the MS", "robots_connected", 2)]
    return _counted(runs, "Connectivity", what, "robots", lines)


def hops_card(runs: Sequence[Run]) -> str:
    what = "Longest and mean route to the monitor station in hops, over simulated time."
    lines = [("longest route", "max_hops", 1), ("mean of all", "mean_hops", 0)]
    return _counted(runs, "Hops to the MS", what, "hops", lines)


def _counted(runs: Sequence[Run], title: str, what: str, y_name: str, columns: Sequence[tuple[str, str, int]]) -> str:
    """A card with columns of metrics.csv over time: name, column and color of each."""
    lines = [
        _line(runs, which, name, run.columns[key], color)
        for which, run in enumerate(runs)
        for name, key, color in columns
        if key in run.columns
    ]
    return card(title, line_chart(title, what, lines, y_name=y_name, marks=_marks(runs)) + legend(lines))


def _line(runs: Sequence[Run], which: int, name: str, column: list[float | None], color: int, note: str = "") -> Line:
    """Of two runs the first is solid, the second dashed."""
    two = len(runs) > 1
    points = list(zip(runs[which].times_s, column, strict=True))
    return Line(f"{'AB'[which]}: {name}" if two else name, points, color, dashed=two and which == 1, note=note)


def _marks(runs: Sequence[Run]) -> list[Mark]:
    marks = []
    for letter, run in zip("AB", runs, strict=False):
        for fault in run.rows("faults")[:_FEW_MARKS]:
            at_s = fault.get("at_s")
            if isinstance(at_s, int | float):
                label = f"{say(fault.get('verb'))} {fault.get('target') or ''}".strip()
                marks.append(Mark(float(at_s), f"{letter}: {label}" if len(runs) > 1 else label))
    return marks


def faults_card(run: Run, title: str = "Faults and recoveries") -> str:
    verdicts = run.rows("recoveries")
    if not verdicts:
        return card(title, "<p class='soft'>No fault took effect in this run.</p>", "" if "of" in title else "wide")
    rows = [_verdict(row) for row in verdicts[:_LONGEST_LIST]]
    heads = ["at", "fault", "recovered", "all had a route after", "first noticed after", "robots cut off"]
    note = _cut_off(len(verdicts))
    return card(title, table(heads, rows, numbers=(0, 3, 4)) + note, "wide")


def _verdict(row: dict[str, Any]) -> list[str]:
    orphaned = row.get("orphaned")
    orphans = ", ".join(map(str, orphaned)) if isinstance(orphaned, list) else ""
    recovered = row.get("recovered")
    kind = "good" if recovered is True else "bad" if recovered is False else "soft"
    what = f"{say(row.get('kind'))} {row.get('target') or ''}".strip()
    return [
        seconds(row.get("at_s")), escape(what), f'<span class="{kind}">{escape(say(recovered))}</span>',
        seconds(row.get("recovered_s")), seconds(row.get("detected_s")), escape(orphans) or "none",
    ]  # fmt: skip


def _counts_card(run: Run) -> str:
    scans, frames = run.group("scan_reports"), run.group("frames")
    rows = [[f"scan reports {escape(key)}", number(scans[key])] for key in scans]
    rows += [
        [f"radio {escape(key) if key == 'bytes' else f'frames {escape(key)}'}", number(frames[key])] for key in frames
    ]
    return card("Counts", table(["what", "how many"], rows, numbers=(1,)))


def _ticks_card(run: Run) -> str:
    blame = {name: share for name, share in run.group("tick_blame").items() if isinstance(share, int | float)}
    bars = sorted((Bar(name, share, percent(share)) for name, share in blame.items()), key=lambda b: -b.value)[:12]
    rows = [[f"tick, {escape(key)}", milliseconds(value)] for key, value in run.group("tick_ms").items()]
    rows.append(["wall time of the run", seconds(run.summary.get("wall_s"))])
    body = table(["what", "wall time"], rows, numbers=(1,))
    if bars:
        body += "<h3>Whom ticks waited for</h3>" + bar_chart("Share of tick time by the process waited for", bars)
    return card("Speed", body)


def _events_card(run: Run) -> str:
    events = [event for event in run.events if event.get("kind") in _SHOWN_EVENTS]
    main = [event for event in events if event.get("kind") != "link"]
    body = _event_table(main) if main else "<p class='soft'>No event was written.</p>"
    links = [event for event in events if event.get("kind") == "link"]
    if links:
        body += f"<details><summary>{len(links)} changes of routes</summary>{_event_table(links)}</details>"
    return card("Events", body, "wide long")


def _event_table(events: Sequence[dict[str, Any]]) -> str:
    rows = [
        [seconds(event["at_s"]), escape(say(event.get("kind"))), escape(say(event.get("text")))]
        for event in events[:_LONGEST_LIST]
    ]
    return table(["at", "kind", "what"], rows, numbers=(0,)) + _cut_off(len(events))


def _cut_off(count: int) -> str:
    if count <= _LONGEST_LIST:
        return ""
    return f"<p class='soft'>{count - _LONGEST_LIST} more are in the run folder.</p>"


def repeat_card(run: Run, title: str = "Repeat this run") -> str:
    body = f"<pre>{escape(repeat_command(run))}</pre>"
    if by_wall_clock := run.summary.get("wall_clock_faults"):
        body += (
            f"<p>{number(by_wall_clock)} of its faults came at a moment of wall time. The repetition has them at the "
            "ticks at which they acted here.</p>"
        )
    meaning = meaning_of(run.summary["status"])
    if not meaning.complete:
        body += f"<p>This run did not come to its end ({escape(meaning.words)}): the repetition may go on further.</p>"
    elif run.summary.get("trace_sha256"):
        digest = escape(str(run.summary["trace_sha256"]))
        body += f'<p>The repetition ends with the same digest:<br><code class="digest">{digest}</code></p>'
    if run.scenario_toml:
        body += (
            "<details><summary>The whole scenario, to be saved as scenario.toml</summary>"
            f"<pre>{escape(run.scenario_toml)}</pre></details>"
        )
    return card(title, body, "wide long")


def repeat_command(run: Run) -> str:
    """The command that repeats a run: with every fault that acted, by schedule or by hand, at its node and its tick."""
    words = (
        ["--replay-faults", str(run.path)] if run.rows("faults") else ["--scenario", str(run.path / "scenario.toml")]
    )
    return f"{call_of('run')} {shlex.join(words)}"
