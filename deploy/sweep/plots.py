"""Pictures of a study's results, as PNG and SVG, in colors that color-blind readers can tell apart (Okabe & Ito)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl

mpl.use("Agg")

from matplotlib import pyplot as plt

from deploy.sweep.bounds import Bounds
from deploy.sweep.plan import BASE, Study
from deploy.sweep.statistics import Interval, censored, kept, mean_rates, usable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw"]

COLORS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")
LINES: Final = ("-", "--", ":", "-.")

_DPI: Final = 150
_MEANS: Final = "mean of min(T, time limit) and 95 % bootstrap interval; hollow: k of n runs finished"
# Without a fixed salt, two drawings of the same results would differ.
_STYLE: Final[Any] = {
    "font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "svg.hashsalt": "vds", "svg.fonttype": "none",
}  # fmt: skip

Row = Mapping[str, Any]


def draw(
    study: Study,
    rows: Sequence[Row],
    series: Mapping[str, Mapping[str, Sequence[float]]],
    bounds: Bounds,
    folder: Path,
) -> list[Path]:
    """Draw what a study asks for; returns the files, PNG before SVG.

    Args:
        study: says which kind of picture.
        rows: of the results.
        series: time series by key.
        bounds: r_low and T_low of the study's arena.
        folder: where the files go, named after the study.
    """
    with plt.rc_context(_STYLE):
        if study.plot == "search_rate":
            figure = _search_rate(study, rows, series)
        elif study.plot == "search_time":
            figure = _search_time(study, rows, bounds)
        else:
            figure = _variants(study, rows)
        try:
            return [_save(figure, folder / f"{study.name}.{kind}") for kind in ("png", "svg")]
        finally:
            plt.close(figure)


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI, metadata={"Date": None} if path.suffix == ".svg" else None)
    return path


def _search_rate(study: Study, rows: Sequence[Row], series: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    """Fig. 6 [paper 8.3]: search rate of each cell against elapsed time, a panel for each N."""
    shown = usable(rows)
    fleets = sorted({row["robots"] for row in shown}, reverse=True)
    figure, axes = plt.subplots(1, max(1, len(fleets)), figsize=(9.5, 3.4), sharey=True, squeeze=False)
    until_s = max((float(row["duration_s"]) for row in shown), default=1.0)
    for axis, robots in zip(axes[0], fleets, strict=False):
        of_fleet = [row for row in shown if row["robots"] == robots]
        left = kept(of_fleet, series, study.discard)
        cells = sorted({cell for row in left for cell in series[row["key"]]} - {"time_s"})
        for i, cell in enumerate(cells):
            band = mean_rates([series[row["key"]] for row in left], cell, until_s)
            color, line = COLORS[i % len(COLORS)], LINES[i % len(LINES)]
            axis.plot(band.time_s, 100 * band.mean, color=color, linestyle=line, label=f"cell {_plain(cell)}")
            axis.fill_between(band.time_s, 100 * band.low, 100 * band.high, color=color, alpha=0.2, linewidth=0)
        axis.set_title(f"N = {robots} ({len(left)} of {len(of_fleet)} runs)")
        axis.set_xlabel("elapsed time (s)")
        axis.set_ylim(0, 102)
        axis.set_xlim(0, until_s)
        if cells:
            axis.legend(loc="lower right")
    axes[0][0].set_ylabel("search rate (%)")
    _caption(figure, study, "mean and 95 % confidence interval")
    return figure


def _search_time(study: Study, rows: Sequence[Row], bounds: Bounds) -> Figure:
    """Fig. 7 [paper 8.4]: search time of all cells against transmission radius, a curve for each N, and bounds."""
    figure, axis = plt.subplots(figsize=(7.2, 4.8))
    shown = usable(rows)
    fleets = sorted({row["robots"] for row in shown})
    variants = [variant.name for variant in study.variant] or [BASE]
    for i, robots in enumerate(fleets):
        color = COLORS[i % len(COLORS)]
        for j, variant in enumerate(variants):
            of_curve = [row for row in shown if row["robots"] == robots and row["variant"] == variant]
            label = f"N = {robots}" if len(variants) == 1 else f"N = {robots}, {_plain(variant)}"
            style = _Style(color, MARKERS[i % len(MARKERS)], LINES[j % len(LINES)])
            _curve(axis, of_curve, label, style)
        if robots in bounds.radio_m:
            axis.axvline(bounds.radio_m[robots], color=color, linestyle=":", linewidth=1)
            axis.annotate(
                f"$r_{{low}}$, N = {robots}", (bounds.radio_m[robots], 0.02), xycoords=("data", "axes fraction"),
                rotation=90, va="bottom", ha="right", color=color, fontsize=7,
            )  # fmt: skip
    axis.axhline(bounds.t_low_s, color="0.5", linewidth=1, label="$T_{low}$")
    axis.set_xlabel("transmission radius $r_t$ (m)")
    axis.set_ylabel("search time $T$ of all cells (s)")
    axis.set_ylim(bottom=0)
    axis.set_xlim(left=0)
    axis.legend(loc="best")
    _caption(figure, study, f"{_MEANS}; cross: none did")
    return figure


@dataclass(frozen=True)
class _Style:
    color: str
    marker: str
    line: str


def _curve(axis: Axes, rows: Sequence[Row], label: str, style: _Style) -> None:
    """One N (and variant) of Fig. 7 [paper 8.4]; a hollow point shows how many of its runs finished."""
    color = style.color
    found = {
        radius_m: censored([row for row in rows if row["radius_m"] == radius_m])
        for radius_m in sorted({row["radius_m"] for row in rows})
    }
    for radius_m, times in found.items():
        point = (radius_m, times.mean_s.value)
        if times.finished == 0:
            axis.plot(*point, marker="x", color=color, ls="", ms=7, zorder=3)
        elif times.finished < times.runs:
            axis.plot(*point, marker=style.marker, color=color, mfc="white", ls="", ms=7, zorder=3)
            words = f"{times.finished}/{times.runs}"
            axis.annotate(words, point, xytext=(5, 3), textcoords="offset points", color=color, fontsize=7)
    means = [times.mean_s for times in found.values()]
    axis.errorbar(
        list(found), [mean.value for mean in means], _whiskers(means), color=color, marker=style.marker, ms=4,
        ls=style.line, lw=1.2, capsize=2.5, label=label,
    )  # fmt: skip


def _whiskers(means: Sequence[Interval]) -> list[list[float]]:
    """Below and above each mean, as Matplotlib wants them."""
    return [[mean.value - mean.low for mean in means], [mean.high - mean.value for mean in means]]


def _variants(study: Study, rows: Sequence[Row]) -> Figure:
    """An ablation: search time of each variant, a panel for each radius and N."""
    shown = usable(rows)
    panels = sorted({(row["robots"], row["radius_m"]) for row in shown})
    names = [variant.name for variant in study.variant] or [BASE]
    figure, axes = plt.subplots(
        1, max(1, len(panels)), figsize=(3.2 + 3.2 * max(1, len(panels)), 1.2 + 0.3 * len(names)), sharey=True,
        squeeze=False,
    )  # fmt: skip
    for axis, (robots, radius_m) in zip(axes[0], panels, strict=False):
        for row, name in enumerate(names):
            here = [r for r in shown if (r["robots"], r["radius_m"], r["variant"]) == (robots, radius_m, name)]
            if not here:
                continue
            times = censored(here)
            complete = times.finished == times.runs
            axis.errorbar(
                times.mean_s.value, row, xerr=_whiskers([times.mean_s]), marker="o", color=COLORS[0], capsize=2.5,
                mfc=COLORS[0] if complete else "white",
            )  # fmt: skip
            if not complete:
                words, spot = f"{times.finished}/{times.runs}", (times.mean_s.value, row)
                axis.annotate(words, spot, xytext=(4, 4), textcoords="offset points", fontsize=7)
        axis.set_title(f"N = {robots}, $r_t$ = {radius_m:g} m")
        axis.set_xlabel("search time of all cells (s)")
        axis.set_xlim(left=0)
    axes[0][0].set_yticks(range(len(names)), [_plain(name) for name in names])
    axes[0][0].invert_yaxis()
    _caption(figure, study, _MEANS)
    return figure


def _caption(figure: Figure, study: Study, words: str) -> None:
    figure.suptitle(f"{_plain(study.title or study.name)}\n{words}", fontsize=9)
    figure.tight_layout()


def _plain(text: str) -> str:
    """A text of the user's, in which $ begins no formula."""
    return text.replace("$", r"\$")
