"""Statistics of the figures: means with confidence intervals, and the runs that a figure leaves out.

Rows are those of `deploy.sweep.results.Results`; a run is complete when all its cells were searched.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap
from scipy.stats import t as student_t

from deploy.run_folder.status import meaning_of
from deploy.sweep.plan import Discard

__all__ = [
    "ALL", "Band", "Estimate", "Interval", "estimate", "goes_first", "kept", "mean_rates", "median_of", "ratio",
    "share_of", "usable",
]  # fmt: skip

ALL: Final = "search_time_s.all"

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Estimate:
    """Mean of a sample with its confidence interval."""

    n: int
    mean: float
    half_width: float
    """The interval is mean +- half_width; NaN for fewer than two values."""
    sd: float
    """Standard deviation of the sample (n - 1)."""


@dataclass(frozen=True)
class Band:
    """A mean over runs, and its confidence interval, over time."""

    time_s: NDArray[np.float64]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    n: int


def estimate(values: Iterable[float], confidence: float = 0.95) -> Estimate:
    """Mean and Student-t confidence interval of independent values."""
    sample = np.asarray(list(values), np.float64)
    n = len(sample)
    if n == 0:
        return Estimate(0, math.nan, math.nan, math.nan)
    if n == 1:
        return Estimate(1, float(sample[0]), math.nan, math.nan)
    sd = float(sample.std(ddof=1))
    quantile = float(student_t.ppf(0.5 + confidence / 2, n - 1))
    return Estimate(n, float(sample.mean()), quantile * sd / math.sqrt(n), sd)


@dataclass(frozen=True)
class Interval:
    """A number and its 95 % confidence interval; NaN for the ends if there is none."""

    value: float
    low: float
    high: float


def median_of(values: Sequence[float]) -> Interval:
    """Median of a sample and its interval by bootstrap (Efron's percentiles, 9,999 resamples, always the same ones).

    Of a sample with times that are censored at a limit the median is right as long as it lies below the limit.
    """
    if len(values) < 2:
        return Interval(values[0] if values else math.nan, math.nan, math.nan)
    found = bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0)).confidence_interval
    return Interval(float(np.median(values)), float(found.low), float(found.high))


def share_of(successes: int, trials: int) -> Interval:
    """Share of successes and its interval after Wilson."""
    found = binomtest(successes, trials).proportion_ci(method="wilson")
    return Interval(successes / trials, float(found.low), float(found.high))


def ratio(pairs: Sequence[tuple[float, float]]) -> Estimate:
    """Ratio of two means over the same runs, with its 95 % interval (Cochran, Sampling Techniques, 6.3).

    Args:
        pairs: (numerator, denominator) of each run; at least one.
    """
    above, below = np.array(pairs, np.float64).T
    found = float(above.mean() / below.mean())
    spread = estimate((above - found * below) / below.mean())
    return Estimate(spread.n, found, spread.half_width, spread.sd)


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
    """The runs that a figure shows: all usable ones but those that search the rule's `cell` first."""
    rows = usable(rows)
    return rows if rule is None else [row for row in rows if goes_first(row, series[row["key"]], rule) != rule.cell]


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
