"""Line and bar charts as SVG text: no library, no script; colors come from the page's CSS (`.s0` to `.s5`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

__all__ = ["COLORS", "Bar", "Line", "Mark", "bar_chart", "legend", "line_chart"]

COLORS: Final = 6
"""How many colors the page has; more lines share them."""

_WIDTH: Final = 480.0
_HEIGHT: Final = 260.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 12.0, 22.0, 38.0
_LABEL_GAP: Final = 62.0
"""Marks that are closer share one label."""

Points = Sequence[tuple[float, float | None]]


@dataclass(frozen=True)
class Line:
    """One curve; y None breaks it."""

    name: str
    points: Points
    color: int
    dashed: bool = False
    note: str = ""
    """Shown behind the name in the legend."""

    @property
    def style(self) -> str:
        return f"line s{self.color % COLORS}" + (" dashed" if self.dashed else "")


@dataclass(frozen=True)
class Mark:
    """A moment, drawn as a vertical line."""

    x: float
    label: str


@dataclass(frozen=True)
class Bar:
    """One bar of a bar chart."""

    name: str
    value: float
    label: str


def line_chart(
    title: str,
    description: str,
    lines: Sequence[Line],
    *,
    y_name: str,
    y_max: float | None = None,
    y_text: Callable[[float], str] = "{:g}".format,
    marks: Sequence[Mark] = (),
) -> str:
    """Curves over simulated seconds, from zero on both axes.

    Args:
        title: accessible name of the picture.
        description: what it shows, for those who can't see it.
        lines: the curves.
        y_name: what the y axis measures.
        y_max: top of the y axis; None = a round number above the highest point.
        y_text: how a number on the y axis reads.
        marks: moments to point out.
    """
    xs = [x for line in lines for x, _ in line.points]
    ys = [y for line in lines for _, y in line.points if y is not None]
    x_max = max([1.0, *xs])
    # Without a given top the axis counts things, so its steps are whole.
    y_step = y_max / 4 if y_max else max(1.0, _round_step(max([1.0, *ys]) / 5))
    top = y_max or math.ceil(max([1.0, *ys]) / y_step) * y_step
    frame = _Frame(x_max, top)
    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{escape(title)}">',
        f"<title>{escape(title)}</title><desc>{escape(description)}</desc>",
        *_y_axis(frame, y_step, y_name, y_text),
        *_x_axis(frame),
        *_marks(frame, marks),
        *(_path(frame, line) for line in lines),
        "</svg>",
    ]
    return "".join(parts)


@dataclass(frozen=True)
class _Frame:
    """Maps data to coordinates of the picture."""

    x_max: float
    y_max: float

    def x(self, value: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * value / self.x_max

    def y(self, value: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * min(value, self.y_max) / self.y_max


def _y_axis(frame: _Frame, step: float, name: str, text: Callable[[float], str]) -> list[str]:
    parts = [f'<text class="axis" x="4" y="12">{escape(name)}</text>']
    for i in range(math.floor(frame.y_max / step + 1e-9) + 1):
        y = frame.y(i * step)
        parts.append(
            f'<path class="grid" d="M{_LEFT:g} {y:.1f}H{_WIDTH - _RIGHT:g}"/>'
            f'<text class="axis end" x="{_LEFT - 6:g}" y="{y + 4:.1f}">{escape(text(i * step))}</text>'
        )
    return parts


def _x_axis(frame: _Frame) -> list[str]:
    unit, seconds = "s", 1.0
    if frame.x_max > 900:
        unit, seconds = ("min", 60.0) if frame.x_max <= 10_800 else ("h", 3600.0)
    step = _round_step(frame.x_max / seconds / 7)
    base = _HEIGHT - _BOTTOM
    parts = []
    for i in range(math.floor(frame.x_max / seconds / step + 1e-9) + 1):
        x = frame.x(i * step * seconds)
        parts.append(
            f'<path class="tick" d="M{x:.1f} {base:g}v5"/>'
            f'<text class="axis middle" x="{x:.1f}" y="{base + 18:g}">{i * step:g}</text>'
        )
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(f'<text class="axis middle" x="{middle:g}" y="{_HEIGHT - 4:g}">simulated time ({unit})</text>')
    return parts


def _marks(frame: _Frame, marks: Sequence[Mark]) -> list[str]:
    parts, free_from = [], 0.0
    for mark in sorted(marks, key=lambda mark: mark.x):
        x = frame.x(min(mark.x, frame.x_max))
        parts.append(
            f'<g><title>{escape(mark.label)}</title><path class="mark" d="M{x:.1f} {_TOP:g}V{_HEIGHT - _BOTTOM:g}"/>'
        )
        if x >= free_from:
            free_from = x + _LABEL_GAP
            end = x > _WIDTH - _RIGHT - _LABEL_GAP
            parts.append(
                f'<text class="mark-name{" end" if end else ""}" x="{x + (-4 if end else 4):.1f}" y="{_TOP + 10:g}">'
                f"{escape(mark.label)}</text>"
            )
        parts.append("</g>")
    return parts


def _path(frame: _Frame, line: Line) -> str:
    pieces, pen = [], "M"
    for x, y in _thin(line.points, frame.x_max):
        if y is None:
            pen = "M"
            continue
        pieces.append(f"{pen}{frame.x(x):.1f} {frame.y(y):.1f}")
        pen = "L"
    return f'<path class="{line.style}" d="{"".join(pieces)}"><title>{escape(line.name)}</title></path>'


def _thin(points: Points, x_max: float) -> Points:
    """At most four points for each half unit of width: first, lowest, highest and last, so that no dip is lost."""
    columns = int(2 * _WIDTH)
    if len(points) <= 4 * columns:
        return points
    kept: list[tuple[float, float | None]] = []
    bucket: list[tuple[float, float | None]] = []
    for point in [*points, (math.inf, None)]:
        if bucket and (math.isinf(point[0]) or _column(point, x_max) != _column(bucket[0], x_max)):
            known = [p for p in bucket if p[1] is not None]
            ends = {bucket[0], bucket[-1]}
            if known:
                ends |= {min(known, key=lambda p: p[1] or 0.0), max(known, key=lambda p: p[1] or 0.0)}
            kept += sorted(ends, key=lambda p: p[0])
            bucket = []
        bucket.append(point)
    return kept


def _column(point: tuple[float, float | None], x_max: float) -> int:
    return int(2 * _WIDTH * point[0] / x_max)


def _round_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, ... that is not below `least`."""
    power = 10.0 ** math.floor(math.log10(max(least, 1e-9)))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least * (1 - 1e-9))


def legend(lines: Sequence[Line]) -> str:
    """The legend as an HTML list: a piece of each line beside its name."""
    items = []
    for line in lines:
        note = f' <span class="note">{escape(line.note)}</span>' if line.note else ""
        swatch = (
            f'<svg class="swatch" viewBox="0 0 26 8" aria-hidden="true"><path class="{line.style}" d="M1 4H25"/></svg>'
        )
        items.append(f"<li>{swatch}{escape(line.name)}{note}</li>")
    return f'<ul class="legend">{"".join(items)}</ul>'


def bar_chart(title: str, bars: Sequence[Bar]) -> str:
    """Horizontal bars, the longest at the top."""
    row, left, right = 22.0, 92.0, 56.0
    ordered = sorted(bars, key=lambda bar: -bar.value)
    longest = max((bar.value for bar in ordered), default=0.0) or 1.0
    height = row * len(ordered) + 4
    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH:g} {height:g}" role="img" aria-label="{escape(title)}">',
        f"<title>{escape(title)}</title>",
    ]
    for i, bar in enumerate(ordered):
        width = max(1.0, (_WIDTH - left - right) * max(bar.value, 0.0) / longest)
        y = i * row
        parts.append(
            f'<text class="axis end" x="{left - 8:g}" y="{y + 16:g}">{escape(bar.name)}</text>'
            f'<rect class="bar" x="{left:g}" y="{y + 4:g}" width="{width:.1f}" height="{row - 7:g}" rx="2"/>'
            f'<text class="axis" x="{left + width + 6:.1f}" y="{y + 16:g}">{escape(bar.label)}</text>'
        )
    return "".join([*parts, "</svg>"])
