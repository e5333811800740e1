"""The HTML of a report: one page that asks nobody for anything. Whatever comes from a file is escaped here."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from deploy.charts import Bar, Line, Mark, bar_chart, legend, line_chart
from deploy.map_picture import MAP_KEY, map_picture
from deploy.run_files import Run

__all__ = ["comparison_page", "repeat_command", "report_page"]

_CSS: Final = Path(__file__).with_name("report.css")
_LONGEST_LIST: Final = 300
_SHOWN_EVENTS: Final = ("mission", "victim", "fault", "drop", "link")
_UNKNOWN: Final = "–"  # noqa: RUF001  # an en dash, as tables have it
_FEW_MARKS: Final = 40


def report_page(run: Run) -> str:
    """The page about one run."""
    summary = run.summary
    what = f"{_say(summary.get('scenario'))}, {_say(summary.get('robots'))} robots, seed {_say(summary.get('seed'))}"
    head = (
        f"<h1>{escape(what)}</h1><p>{_status(run)} <span class='soft'>after {_seconds(summary.get('simulated_s'))} "
        f"simulated in {_seconds(summary.get('wall_s'))}, transmission radius "
        f"{_number(summary.get('radius_m'))} m, run folder {escape(run.name)}</span></p>"
    )
    body = [
        head,
        _tiles(run),
        _trouble(run),
        '<div class="cards"><div class="column">',
        _map_card(run),
        _cells_card(run),
        '</div><div class="column">',
        _search_card([run]),
        _connected_card([run]),
        _hops_card([run]),
        "</div>",
        _faults_card(run),
        _counts_card(run),
        _ticks_card(run),
        _events_card(run),
        _repeat_card(run),
        "</div>",
    ]
    return _page(f"Run {run.name}: {what}", "one", body)


def comparison_page(a: Run, b: Run) -> str:
    """The page about two runs: what differs, curves over each other, maps side by side."""
    head = (
        f"<h1>{escape(a.name)} and {escape(b.name)}</h1>"
        f"<p>A: {escape(str(a.path))} {_status(a)}<br>B: {escape(str(b.path))} {_status(b)}</p>"
    )
    runs = [a, b]
    body = [
        head,
        '<div class="cards">',
        _difference_card(a, b),
        _search_card(runs),
        _connected_card(runs),
        _hops_card(runs),
        *(_map_card(run, f"Map of {letter}") for letter, run in zip("AB", runs, strict=True)),
        *(_faults_card(run, f"Faults of {letter}") for letter, run in zip("AB", runs, strict=True)),
        *(_repeat_card(run, f"Repeat {letter}") for letter, run in zip("AB", runs, strict=True)),
        "</div>",
    ]
    return _page(f"{a.name} and {b.name}", "two", body)


def _page(title: str, kind: str, body: Iterable[str]) -> str:
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        # Even a file that found a way past the escaping could not fetch or run anything.
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        'img-src data:"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{_CSS.read_text(encoding='utf-8')}</style></head>"
        f'<body class="{kind}"><main>{"".join(body)}</main>'
        "<footer>Made by deploy/report.py of the VDS emulator. Times are simulated unless they say otherwise.</footer>"
        "</body></html>\n"
    )


# Words for values


def _say(value: object) -> str:
    """A value of unknown kind as text, not yet escaped."""
    if value is None or value == "":
        return _UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f") if abs(value) >= 10_000 else str(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _number(value: object, digits: int = 1) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _UNKNOWN if value is None else escape(str(value))
    return f"{value:.{digits}f}" if isinstance(value, float) else escape(_say(value))


def _seconds(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _UNKNOWN
    return f"{value:.1f} s"


def _percent(value: object, digits: int = 0) -> str:
    """A share; what is not all is never rounded up to 100 %."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _UNKNOWN
    shown = f"{100 * value:.{digits}f}"
    if value < 1 and float(shown) >= 100:
        return f"{100 - 10**-digits:.{digits}f} %" if digits else "99 %"
    return f"{shown} %"


def _mean_rate(run: Run) -> float | None:
    rates = [rate for rate in run.table("search_rate").values() if isinstance(rate, int | float)]
    return sum(rates) / len(rates) if rates else None


def _cell(name: str) -> str:
    return f"Cell {name}" if name.isdigit() else name


# Pieces of a page


def _status(run: Run) -> str:
    words = {
        "searched": ("good", "all cells searched"),
        "time_limit": ("soft", "time limit reached"),
        "interrupted": ("soft", "interrupted"),
        "failed": ("bad", "failed"),
    }
    kind, text = words.get(str(run.summary["status"]), ("bad", str(run.summary["status"])))
    return f'<span class="badge {kind}">{escape(text)}</span>'


def _tiles(run: Run) -> str:
    summary = run.summary
    search_time, victims, verdicts = run.table("search_time_s"), run.table("victims"), run.rows("recoveries")
    affected = [row for row in verdicts if row.get("recovered") != "not affected"]
    healed = sum(row.get("recovered") is True for row in affected)
    tick_ms = run.table("tick_ms")
    tiles = [
        ("Searched", _percent(_mean_rate(run)), f"all after {_seconds(search_time.get('all'))}"),
        ("Victims found", f"{_number(victims.get('found'))} of {_number(victims.get('placed'))}", ""),
        ("Connected", _percent(summary.get("connected_fraction"), 2), "of all robot time"),
        ("Most hops", _number(summary.get("max_hops")), "to the monitor station"),
        ("Faults", str(len(run.rows("faults"))), f"recovered {healed} of {len(affected)} that cut robots off"),
        ("Real-time factor", _number(summary.get("real_time_factor")), "simulated over wall time"),
        ("Tick", f"{_number(tick_ms.get('p50'))} ms", f"median; 99 % below {_number(tick_ms.get('p99'))} ms"),
        ("Simulated", _seconds(summary.get("simulated_s")), f"{_number(summary.get('ticks'))} ticks"),
    ]
    items = "".join(
        f'<div class="tile"><dt>{name}</dt><dd>{value}{f"<small>{note}</small>" if note else ""}</dd></div>'
        for name, value, note in tiles
    )
    return f'<dl class="tiles">{items}</dl>'


def _card(title: str, body: str, kind: str = "") -> str:
    return f'<section class="{kind}"><h2>{escape(title)}</h2>{body}</section>'


def _trouble(run: Run) -> str:
    """What failed, if anything did."""
    failures = run.summary.get("failures")
    told = [*failures] if isinstance(failures, list) else []
    if run.summary.get("why"):
        told.insert(0, run.summary["why"])
    if not told:
        return ""
    return _card("What failed", "".join(f"<pre>{escape(str(words))}</pre>" for words in told), "wide bad-news")


def _map_card(run: Run, title: str = "Map at the end") -> str:
    picture = map_picture(run)
    if picture is None:
        return _card(title, "<p class='soft'>The run left no map.</p>")
    shapes = {
        "hop": '<path class="hop" d="M2 9H20"/>',
        "station": '<rect class="station" x="4" y="2" width="14" height="14"/>',
        "gone": '<path class="gone" d="M5 3l12 12m0-12l-12 12"/>',
        "found": '<path class="found" d="M11 2l6 13h-12z"/>',
        "missed": '<path class="missed" d="M11 2l6 13h-12z"/>',
    }
    items = "".join(
        f'<li><svg class="swatch" viewBox="0 0 22 18" aria-hidden="true">'
        f"{shapes.get(kind, f'<circle class="{kind}" cx="11" cy="9" r="6"/>')}</svg>{words}</li>"
        for kind, words in MAP_KEY
    )
    return _card(title, f'{picture}<ul class="legend key">{items}</ul>')


def _cells_card(run: Run) -> str:
    times = run.table("search_time_s")
    rows = [
        [escape(_cell(name)), _percent(rate, 1), _seconds(times.get(name))]
        for name, rate in run.table("search_rate").items()
    ]
    return _card("Search cells", _table(["cell", "searched", "all of it after"], rows, numbers=(1, 2)))


def _search_card(runs: Sequence[Run]) -> str:
    lines = []
    for number, run in enumerate(runs):
        for i, (name, rates) in enumerate(run.search_rates.items()):
            note = _percent(rates[-1] if rates else None)
            lines.append(_line(runs, number, _cell(name), list(zip(run.times_s, rates, strict=True)), i, note))
    chart = line_chart(
        "Searched share of each cell",
        "Share of each cell that is searched, over simulated time.",
        lines,
        y_name="searched",
        y_max=1.0,
        y_text=lambda share: f"{share:.0%}",
        marks=_marks(runs),
    )
    return _card("Search rate", chart + legend(lines))


def _connected_card(runs: Sequence[Run]) -> str:
    lines = []
    for number, run in enumerate(runs):
        here = [("robots that take part", "robots_present", 5), ("with a route to the MS", "robots_connected", 2)]
        lines += _columns(runs, number, here)
    chart = line_chart(
        "Robots with a route to the monitor station",
        "Robots that take part and robots that have a route to the monitor station, over simulated time.",
        lines,
        y_name="robots",
        marks=_marks(runs),
    )
    return _card("Connectivity", chart + legend(lines))


def _hops_card(runs: Sequence[Run]) -> str:
    lines = []
    for number, run in enumerate(runs):
        lines += _columns(runs, number, [("longest route", "max_hops", 1), ("mean of all", "mean_hops", 0)])
    chart = line_chart(
        "Hops to the monitor station",
        "Longest and mean route to the monitor station in hops, over simulated time.",
        lines,
        y_name="hops",
        marks=_marks(runs),
    )
    return _card("Hops to the MS", chart + legend(lines))


def _columns(runs: Sequence[Run], number: int, columns: Sequence[tuple[str, str, int]]) -> list[Line]:
    run = runs[number]
    return [
        _line(runs, number, name, list(zip(run.times_s, run.columns[key], strict=True)), color)
        for name, key, color in columns
        if key in run.columns
    ]


def _line(
    runs: Sequence[Run], number: int, name: str, points: list[tuple[float, float | None]], color: int, note: str = ""
) -> Line:
    """Of two runs the first is solid, the second dashed."""
    two = len(runs) > 1
    return Line(f"{'AB'[number]}: {name}" if two else name, points, color, dashed=two and number == 1, note=note)


def _marks(runs: Sequence[Run]) -> list[Mark]:
    marks = []
    for letter, run in zip("AB", runs, strict=False):
        for fault in run.rows("faults")[:_FEW_MARKS]:
            at_s = fault.get("at_s")
            if isinstance(at_s, int | float):
                label = f"{_say(fault.get('verb'))} {fault.get('target') or ''}".strip()
                marks.append(Mark(float(at_s), f"{letter}: {label}" if len(runs) > 1 else label))
    return marks


def _faults_card(run: Run, title: str = "Faults and recoveries") -> str:
    verdicts = run.rows("recoveries")
    if not verdicts:
        return _card(title, "<p class='soft'>No fault took effect in this run.</p>", "" if "of" in title else "wide")
    rows = [_verdict(row) for row in verdicts[:_LONGEST_LIST]]
    heads = ["at", "fault", "robots cut off", "first noticed after", "all had a route after", "recovered"]
    note = _cut_off(len(verdicts))
    return _card(title, _table(heads, rows, numbers=(0, 3, 4)) + note, "wide")


def _verdict(row: dict[str, Any]) -> list[str]:
    orphaned = row.get("orphaned")
    orphans = ", ".join(map(str, orphaned)) if isinstance(orphaned, list) else ""
    recovered = row.get("recovered")
    kind, words = {True: ("good", "yes"), False: ("bad", "no")}.get(recovered, ("soft", _say(recovered)))  # type: ignore[call-overload]
    what = f"{_say(row.get('kind'))} {row.get('target') or ''}".strip()
    return [
        _seconds(row.get("at_s")), escape(what), escape(orphans) or "none", _seconds(row.get("detected_s")),
        _seconds(row.get("recovered_s")), f'<span class="{kind}">{escape(words)}</span>',
    ]  # fmt: skip


def _counts_card(run: Run) -> str:
    scans, frames = run.table("scan_reports"), run.table("frames")
    rows = [[f"scan reports {escape(key)}", _number(scans[key])] for key in scans]
    rows += [[f"radio {escape(key) if key == 'bytes' else f'frames {escape(key)}'}", _number(frames[key])] for key in frames]
    return _card("Counts", _table(["what", "how many"], rows, numbers=(1,)))


def _ticks_card(run: Run) -> str:
    blame = {name: share for name, share in run.table("tick_blame").items() if isinstance(share, int | float)}
    bars = sorted((Bar(name, share, _percent(share)) for name, share in blame.items()), key=lambda b: -b.value)[:12]
    rows = [[f"tick, {escape(key)}", f"{_number(value)} ms"] for key, value in run.table("tick_ms").items()]
    rows.append(["wall time of the run", _seconds(run.summary.get("wall_s"))])
    body = _table(["what", "wall time"], rows, numbers=(1,))
    if bars:
        body += "<h3>Whom ticks waited for</h3>" + bar_chart("Share of tick time by the process waited for", bars)
    return _card("Speed", body)


def _events_card(run: Run) -> str:
    events = [event for event in run.events if event.get("kind") in _SHOWN_EVENTS]
    main = [event for event in events if event.get("kind") != "link"]
    body = _event_table(main) if main else "<p class='soft'>No event was written.</p>"
    links = [event for event in events if event.get("kind") == "link"]
    if links:
        body += f"<details><summary>{len(links)} changes of routes</summary>{_event_table(links)}</details>"
    return _card("Events", body, "wide long")


def _event_table(events: Sequence[dict[str, Any]]) -> str:
    rows = [
        [_seconds(event["at_s"]), escape(_say(event.get("kind"))), escape(_say(event.get("text")))]
        for event in events[:_LONGEST_LIST]
    ]
    return _table(["at", "kind", "what"], rows, numbers=(0,)) + _cut_off(len(events))


def _cut_off(count: int) -> str:
    if count <= _LONGEST_LIST:
        return ""
    return f"<p class='soft'>{count - _LONGEST_LIST} more are in the run folder.</p>"


def _repeat_card(run: Run, title: str = "Repeat this run") -> str:
    body = f"<pre>{escape(repeat_command(run))}</pre>"
    by_wall_clock = run.summary.get("wall_clock_faults")
    if by_wall_clock:
        body += (
            f"<p>{_number(by_wall_clock)} of its faults fell at a moment of wall time: the repetition does the same, "
            "but not to the bit.</p>"
        )
    elif run.summary.get("trace_sha256"):
        digest = escape(str(run.summary["trace_sha256"]))
        body += f'<p>The repetition ends with the same digest:<br><code class="digest">{digest}</code></p>'
    if run.scenario_toml:
        body += (
            "<details><summary>The whole scenario, to be saved as scenario.toml</summary>"
            f"<pre>{escape(run.scenario_toml)}</pre></details>"
        )
    return _card(title, body, "wide long")


def repeat_command(run: Run) -> str:
    """The command that repeats a run, with the faults that its scenario does not have because a hand made them."""
    words = ["deploy/run_local.py", "--scenario", str(run.path / "scenario.toml")]
    planned: set[tuple[object, object]] = set()
    if run.scenario is not None:
        planned = {(fault.verb, fault.at_s) for fault in run.scenario.tables.fault}
    for fault in run.rows("faults"):
        if (fault.get("verb"), fault.get("at_s")) not in planned:
            words += ["--fault", _fault_text(fault)]
    return shlex.join(words)


def _fault_text(fault: dict[str, Any]) -> str:
    what = fault.get("probability") if fault.get("verb") == "loss" else fault.get("target", "")
    lasting = f"+{fault['for_s']}" if fault.get("for_s") is not None else ""
    return f"{fault.get('verb')}:{what}@{fault.get('at_s')}{lasting}"


# Two runs

_Value = Callable[[Run], object]
_COMPARED: Final[tuple[tuple[str, _Value, Callable[[object], str]], ...]] = (
    ("status", lambda run: run.summary["status"], _number),
    ("scenario", lambda run: run.summary.get("scenario"), _number),
    ("robots", lambda run: run.summary.get("robots"), _number),
    ("radius, m", lambda run: run.summary.get("radius_m"), _number),
    ("seed", lambda run: run.summary.get("seed"), _number),
    ("policy", lambda run: None if run.scenario is None else run.scenario.tables.policy, _number),
    ("searched", _mean_rate, lambda value: _percent(value, 1)),
    ("all searched after", lambda run: run.table("search_time_s").get("all"), _seconds),
    ("victims found", lambda run: run.table("victims").get("found"), _number),
    ("connected", lambda run: run.summary.get("connected_fraction"), lambda value: _percent(value, 2)),
    ("most hops", lambda run: run.summary.get("max_hops"), _number),
    ("faults", lambda run: len(run.rows("faults")), _number),
    ("faults recovered", lambda run: sum(row.get("recovered") is True for row in run.rows("recoveries")), _number),
    ("scan reports made", lambda run: run.table("scan_reports").get("made"), _number),
    ("scan reports merged", lambda run: run.table("scan_reports").get("merged"), _number),
    ("frames sent", lambda run: run.table("frames").get("sent"), _number),
    ("bytes on the radio", lambda run: run.table("frames").get("bytes"), _number),
    ("simulated", lambda run: run.summary.get("simulated_s"), _seconds),
    ("real-time factor", lambda run: run.summary.get("real_time_factor"), _number),
    ("tick, median ms", lambda run: run.table("tick_ms").get("p50"), _number),
)


def _difference_card(a: Run, b: Run) -> str:
    rows = []
    for name, value, show in _COMPARED:
        first, second = value(a), value(b)
        rows.append([name, show(first), show(second), _difference(first, second, show)])
    for name in dict.fromkeys([*a.table("search_time_s"), *b.table("search_time_s")]):
        if name != "all":
            first, second = a.table("search_time_s").get(name), b.table("search_time_s").get(name)
            rows.append([
                f"{escape(_cell(name))} searched after", _seconds(first), _seconds(second),
                _difference(first, second, _seconds),
            ])  # fmt: skip
    same = a.summary.get("trace_sha256") == b.summary.get("trace_sha256") is not None
    rows.append(["same to the bit", "", "", "yes" if same else "no"])
    return _card("What differs", _table(["", "A", "B", "B less A"], rows, numbers=(1, 2, 3)), "wide")


def _difference(first: object, second: object, show: Callable[[object], str]) -> str:
    numbers = (int, float)
    if isinstance(first, numbers) and isinstance(second, numbers):
        gap = second - first
        text = show(round(gap, 6))
        return "same" if gap == 0 else f"+{text}" if gap > 0 else text.replace("-", "\u2212")
    return "same" if first == second else "differs"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int] = ()) -> str:
    """A table of cells that are escaped already."""

    def row(tag: str, cells: Sequence[str]) -> str:
        classes = (' class="number"' if i in numbers else "" for i in range(len(cells)))
        return "<tr>" + "".join(f"<{tag}{c}>{cell}</{tag}>" for c, cell in zip(classes, cells, strict=True)) + "</tr>"

    body = "".join(row("td", cells) for cells in rows)
    return f'<div class="scroll"><table><thead>{row("th", heads)}</thead><tbody>{body}</tbody></table></div>'
