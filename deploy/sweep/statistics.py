"""Statistics of the figures: means with confidence intervals, and the runs that a figure leaves out.

Rows are those of `deploy.sweep.results.Results`; a run is complete when all its cells were searched. One that was not
is censored at its time limit: it counts as min(T, limit), and is left out of no mean. Intervals of such means are
bootstrap percentiles, since the times of a point with unfinished runs are far from normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap
from scipy.stats import t as student_t

from deploy.run_folder.status import meaning_of
from deploy.sweep.plan import Discard

__all__ = [
    "ALL", "Band", "Censored", "Interval", "censored", "censored_s", "goes_first", "kept", "mean_rates", "median_of",
    "ratio", "share_of", "usable",
]  # fmt: skip

ALL: Final = "search_time_s.all"
_RESAMPLES: Final = 2000

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval, which is the value itself for a single run."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Censored:
    """Search times of some runs, each censored at its time limit."""

    runs: int
    finished: int
    mean_s: Interval
    """Of min(T, limit)."""


@dataclass(frozen=True)
class Band:
    """A mean over runs, and its confidence interval, over time."""

    time_s: NDArray[np.float64]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    n: int


def censored_s(row: Row, column: str = ALL) -> float:
    """min(T, limit) of a run: its search time, or its time limit if it did not finish."""
    time_s = row[column]
    return float(row["duration_s"] if time_s is None else time_s)


def censored(rows: Sequence[Row], column: str = ALL) -> Censored:
    """How many of at least one run finished, and the mean of min(T, limit)."""
    times = np.array([censored_s(row, column) for row in rows])
    finished = sum(row[column] is not None for row in rows)
    return Censored(len(rows), finished, _bootstrapped((times,), lambda x, axis=-1: x.mean(axis=axis)))


def median_of(values: Sequence[float]) -> Interval:
    """Median of a sample; all of them NaN if it is empty.

    Of a sample with times that are censored at a limit the median is right as long as it lies below the limit.
    """
    if not values:
        return Interval(math.nan, math.nan, math.nan)
    return _bootstrapped((np.array(values),), np.median)


def share_of(successes: int, trials: int) -> Interval:
    """Share of successes and its interval after Wilson."""
    found = binomtest(successes, trials).proportion_ci(method="wilson")
    return Interval(successes / trials, float(found.low), float(found.high))


def ratio(pairs: Sequence[tuple[float, float]]) -> Interval:
    """Ratio of two means over the same seeds, which are resampled together.

    Args:
        pairs: (numerator, denominator) of each seed; at least one.
    """
    above, below = np.array(pairs, np.float64).T
    return _bootstrapped((above, below), lambda a, b, axis=-1: a.mean(axis=axis) / b.mean(axis=axis))


def _bootstrapped(samples: tuple[NDArray[np.float64], ...], statistic: Callable[..., Any]) -> Interval:
    value = float(statistic(*samples))
    if len(samples[0]) < 2:
        return Interval(value, value, value)
    # A generator of its own for each interval: what else a page shows changes no number of it.
    found = bootstrap(
        samples, statistic, n_resamples=_RESAMPLES, paired=len(samples) > 1, method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return Interval(value, float(found.low), float(found.high))


def usable(rows: Iterable[Row]) -> list[Row]:
    """Rows of runs that have a result: that neither failed nor lost all robots nor were interrupted."""
    return [row for row in rows if meaning_of(row["status"]).result]


def goes_first(row: Row, series: Mapping[str, Sequence[float]], rule: Discard) -> str | None:
    """Which of the two cells of a discard rule a run searched first; None if it began neither.

    The one that was finished first; if neither was, the one whose search rate first reached `onset_rate`.
    """
    for times in (
        {cell: row.get(f"search_time_s.{cell}") for cell in (rule.cell, rule.before)},
        {cell: _reaches(series, cell, rule.onset_rate) for cell in (rule.cell, rule.before)},
    ):
        reached = {cell: time for cell, time in times.items() if time is not None}
        if reached:
            return min(reached, key=lambda cell: reached[cell])
    return None


def kept(rows: Iterable[Row], series: Mapping[str, Mapping[str, Sequence[float]]], rule: Discard | None) -> list[Row]:
    """The runs that a figure shows: all usable ones but those that search the rule's `cell` first.

    A run without a time series began neither cell, as far as anybody can tell.
    """
    rows = usable(rows)
    if rule is None:
        return rows
    return [row for row in rows if goes_first(row, series.get(row["key"], {}), rule) != rule.cell]


def _reaches(series: Mapping[str, Sequence[float]], cell: str, rate: float) -> float | None:
    pairs = zip(series.get("time_s", ()), series.get(cell, ()), strict=True)
    return next((time_s for time_s, value in pairs if value >= rate), None)


def mean_rates(series: Sequence[Mapping[str, Sequence[float]]], cell: str, until_s: float) -> Band:
    """Mean search rate of one cell over time; a run that has ended keeps its last rate."""
    time_s = np.arange(0.0, until_s + 1.0)
    rates = np.array([_stretched(of_run, cell, time_s) for of_run in series]).reshape(len(series), len(time_s))
    n = len(series)
    if n == 0:
        empty = np.full(len(time_s), math.nan)
        return Band(time_s, empty, empty, empty, 0)
    mean = rates.mean(axis=0)
    if n == 1:
        return Band(time_s, mean, mean, mean, 1)
    half = float(student_t.ppf(0.975, n - 1)) * rates.std(axis=0, ddof=1) / math.sqrt(n)
    return Band(time_s, mean, np.clip(mean - half, 0.0, 1.0), np.clip(mean + half, 0.0, 1.0), n)


def _stretched(of_run: Mapping[str, Sequence[float]], cell: str, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rate of a run at each time: the last value up to then."""
    at = np.searchsorted(np.asarray(of_run["time_s"]), time_s, side="right") - 1
    rates = np.asarray(of_run[cell], np.float64)
    return np.where(at >= 0, rates[np.maximum(at, 0)], 0.0)
