"""What the figures are made of: means with confidence intervals, runs left out, and the lower bounds r_low and T_low.

Rows are those of `study_table.Results`; a run is complete when all its cells were searched.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.stats import t as student_t

from deploy.scenario import Scenario
from deploy.scenario.arena import Arena
from deploy.sweep.plan import Discard
from deploy.sweep.row import ERROR
from world.geometry import walls_crossed

__all__ = [
    "ALL", "Band", "Bounds", "Estimate", "bounds_of", "estimate", "goes_first", "kept", "mean_rates", "ratio",
    "usable",
]  # fmt: skip

ALL: Final = "search_time_s.all"

_SWEEP_S: Final = (0.0, 40.0)
"""What it takes beyond the straight walk to see the last corner: nothing, if enough robots share the rooms; 25 to 40 s
as an independent prototype measured it."""

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Estimate:
    """Mean of a sample with its confidence interval."""

    n: int
    mean: float
    half_width: float
    """The interval is mean +- half_width; not a number for fewer than two values."""
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


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of an arena (paper, Fig. 7)."""

    farthest_m: float
    """L_far: the longest of the shortest paths from the MS to a point of a search cell."""
    lidar_m: float
    speed_m_s: float
    r_in_share: float

    @property
    def t_low_s(self) -> tuple[float, float]:
        """T_low, from and to: a lone robot that walks straight to where it sees the farthest point, plus the sweep.

        Nobody can be faster than the walk, but for the few metres from the MS at which robots start; what the sweep
        takes depends on the rooms and on how many share them, so this is a band.
        """
        walk_s = (self.farthest_m - self.lidar_m) / self.speed_m_s
        return walk_s + _SWEEP_S[0], walk_s + _SWEEP_S[1]

    @property
    def t_low_mid_s(self) -> float:
        """Middle of the band, the reference for "within so many per cent of T_low"."""
        return sum(self.t_low_s) / 2

    def r_low_m(self, robots: int) -> float:
        """r_low: N robots in a chain along the path, each link as long as inner link recovery allows, r_in.

        The last robot sees one lidar range farther, and the chain gains up to one link more at its head.
        """
        return (self.farthest_m - self.lidar_m) / (self.r_in_share * (robots + 1))


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
    """Rows of runs that ended by themselves."""
    return [row for row in rows if row["status"] not in (ERROR, "failed", "interrupted")]


def goes_first(row: Row, series: Mapping[str, Sequence[float]], rule: Discard) -> str | None:
    """Which of the two cells of a discard rule a run searched first; None if neither.

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
    """The runs that a figure shows: all but those that search the rule's `cell` first."""
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
    """A run's rate at each time: the last value known by then."""
    at = np.searchsorted(np.asarray(of_run["time_s"]), time_s, side="right") - 1
    rates = np.asarray(of_run[cell], np.float64)
    return np.where(at >= 0, rates[np.maximum(at, 0)], 0.0)


def bounds_of(scenario: Scenario) -> Bounds:
    """The lower bounds of a scenario, from its true floor plan."""
    rules = scenario.tables.rules
    return Bounds(
        _farthest_m(scenario.arena), scenario.tables.lidar.range_m, rules.moving.speed_m_s, rules.routing.r_in_share
    )


def _farthest_m(arena: Arena) -> float:
    """Longest of the shortest paths from the MS to the search cells, pulled taut around the corners."""
    cells = np.concatenate([cell.cells for cell in arena.search_cells])
    source = arena.geometry.index(*arena.station_m)
    lengths, before = dijkstra(_walkable(arena), indices=source, return_predecessors=True)
    # The grid's own lengths are up to 8 % too long, by direction: several far corners are pulled taut.
    far = cells[np.argsort(lengths[cells])[-400:]]
    return max(_taut_m(arena, before, int(cell)) for cell in far[np.isfinite(lengths[far])])


def _walkable(arena: Arena) -> Any:
    """Graph of free cells and their eight neighbors; a diagonal step needs both cells that it passes between."""
    free = ~arena.occupied
    rows, cols = free.shape
    number = np.arange(free.size).reshape(rows, cols)
    starts, ends, weights = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        r, c = np.nonzero(free)
        inside = (r + dr < rows) & (c + dc >= 0) & (c + dc < cols)
        r, c = r[inside], c[inside]
        passable = free[r + dr, c + dc] & free[r, c + dc] & free[r + dr, c]
        starts.append(number[r[passable], c[passable]])
        ends.append(number[r[passable] + dr, c[passable] + dc])
        weights.append(np.full(int(passable.sum()), math.hypot(dr, dc) * arena.geometry.resolution_m))
    a, b, w = map(np.concatenate, (starts, ends, weights))
    return csr_array((np.r_[w, w], (np.r_[a, b], np.r_[b, a])), shape=(free.size, free.size))


def _taut_m(arena: Arena, before: NDArray[np.int32], cell: int) -> float:
    """Length of the path to a cell, with every stop left out that is not needed to see past the walls."""
    path = [cell]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    places = arena.geometry.centers(np.array(path))
    length_m, at = 0.0, 0
    while at < len(places) - 1:
        ahead = places[at + 1 :]
        seen = walls_crossed(arena.occupied, arena.geometry, np.broadcast_to(places[at], ahead.shape), ahead) == 0
        step = at + 1 + int(np.flatnonzero(seen)[-1])
        length_m += math.dist(places[at], places[step])
        at = step
    return length_m
