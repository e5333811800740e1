"""The HTML of a report: values as text, cards, tables, and the page around them.

`say` returns plain text. All other functions return HTML with all text from outside escaped.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

__all__ = ["GENERATOR", "UNKNOWN", "card", "milliseconds", "number", "page", "percent", "say", "seconds", "table"]

_CSS: Final = Path(__file__).with_name("report.css")
GENERATOR: Final = '<meta name="generator" content="deploy/report.py of the VDS emulator">'
"""Near the start of every page."""
UNKNOWN: Final = "\u2013"


def page(title: str, kind: str, body: Iterable[str]) -> str:
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"{GENERATOR}"
        # A second defense: text that is not escaped by mistake can neither fetch nor run anything.
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        'img-src data:"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{_CSS.read_text(encoding='utf-8')}</style></head>"
        f'<body class="{kind}"><main>{"".join(body)}</main>'
        "<footer>Made by the VDS emulator. Times are simulated unless they say otherwise.</footer>"
        "</body></html>\n"
    )


def say(value: object) -> str:
    """A value of unknown kind as text, not yet escaped."""
    if value is None or value == "":
        return UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f") if abs(value) >= 10_000 else str(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def number(value: object, digits: int = 1) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return UNKNOWN if value is None else escape(str(value))
    return f"{value:.{digits}f}" if isinstance(value, float) else escape(say(value))


def seconds(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return UNKNOWN
    return f"{value:.1f} s"


def milliseconds(value: object) -> str:
    return UNKNOWN if value is None else f"{number(value)} ms"


def percent(value: object, digits: int = 0) -> str:
    """A share in per cent; only all of it is 100 %, however close the rest comes."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return UNKNOWN
    shown = f"{100 * value:.{digits}f}"
    if value < 1 and float(shown) >= 100:
        return f"{100 - 10**-digits:.{digits}f} %" if digits else "99 %"
    return f"{shown} %"


def card(title: str, body: str, kind: str = "") -> str:
    return f'<section class="{kind}"><h2>{escape(title)}</h2>{body}</section>'


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int] = ()) -> str:
    """A table of cells that are escaped already."""

    def row(tag: str, cells: Sequence[str]) -> str:
        classes = (' class="number"' if i in numbers else "" for i in range(len(cells)))
        return "<tr>" + "".join(f"<{tag}{c}>{cell}</{tag}>" for c, cell in zip(classes, cells, strict=True)) + "</tr>"

    body = "".join(row("td", cells) for cells in rows)
    return f'<div class="scroll"><table><thead>{row("th", heads)}</thead><tbody>{body}</tbody></table></div>'
