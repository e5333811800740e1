"""The claims of the paper's text on its Fig. 6 and 7 [paper 8.3, 8.4], judged by the results of the studies.

The text has words only, so the thresholds are ours. Each stands beside its claim.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import spearmanr

from deploy.sweep.bounds import Bounds
from deploy.sweep.plan import Discard
from deploy.sweep.statistics import ALL, estimate, kept, mean_rates, usable

__all__ = ["Verdict", "fig6_claims", "fig7_claims"]

Row = Mapping[str, Any]
SeriesByKey = Mapping[str, Mapping[str, Sequence[float]]]


@dataclass(frozen=True)
class Verdict:
    """One claim and its verdict."""

    claim: str
    found: str
    """The numbers that decide."""
    holds: bool | None
    """None: there are no results to judge it by."""

    @property
    def word(self) -> str:
        return {True: "holds", False: "does not hold", None: "not measured"}[self.holds]


def fig6_claims(rows: Sequence[Row], series: SeriesByKey, discard: Discard | None) -> list[Verdict]:
    """Claims on Fig. 6 [paper 8.3]; the runs that the study's rule discards are left out."""
    fleets = {n: kept([row for row in rows if row["robots"] == n], series, discard) for n in (6, 9, 12)}
    ends = {n: _end_rates(left, series) for n, left in fleets.items()}
    return [_one_after_the_other(fleets[12], ends[12]), _hardly(fleets[6], ends[6]), _intermediate(fleets, ends)]


def _end_rates(rows: Sequence[Row], series: SeriesByKey) -> tuple[float, float] | None:
    """Mean search rates of cells 1 and 2 at the time limit."""
    if not rows:
        return None
    until_s = max(float(row["duration_s"]) for row in rows)
    first, second = (float(mean_rates([series[r["key"]] for r in rows], c, until_s).mean[-1]) for c in ("1", "2"))
    return first, second


def _one_after_the_other(rows: Sequence[Row], end: tuple[float, float] | None) -> Verdict:
    """Both cells are searched in at least 90 % of the runs, and cell 1 before cell 2 in as many."""
    claim = "N = 12: reconnaissance of cell 1 is accomplished first, then the chain transforms to cell 2"
    if end is None:
        return Verdict(claim, "", None)
    pairs = [(row["search_time_s.1"], row["search_time_s.2"]) for row in rows]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    ordered = [a < b for a, b in both]
    first, second = (estimate(column).mean for column in zip(*both, strict=True)) if both else (float("nan"),) * 2
    found = (
        f"{len(both)} of {len(rows)} runs finish both, {sum(ordered)} in that order: {first:.0f} s, then {second:.0f} s"
    )
    return Verdict(claim, found, sum(ordered) >= 0.9 * len(rows))


def _hardly(rows: Sequence[Row], end: tuple[float, float] | None) -> Verdict:
    """No run finishes both cells, and on average less than half of either is searched at the end."""
    claim = "N = 6: a cell is not accomplished in one time, and the search rate for either cell hardly increases"
    if end is None:
        return Verdict(claim, "", None)
    both = sum(row[ALL] is not None for row in rows)
    found = f"{both} of {len(rows)} runs finish both; {end[0]:.0%} and {end[1]:.0%} are reached at the time limit"
    return Verdict(claim, found, both == 0 and max(end) < 0.5)


def _intermediate(fleets: Mapping[int, Sequence[Row]], ends: Mapping[int, tuple[float, float] | None]) -> Verdict:
    """The share of the time for which a cell is already finished lies between those of N = 6 and N = 12."""
    claim = "N = 9 is the intermediate case"
    if None in ends.values():
        return Verdict(claim, "", None)
    shares = {n: _mean_over_time(left) for n, left in fleets.items()}
    words = ", ".join(f"{share:.0%} for N = {n}" for n, share in sorted(shares.items()))
    return Verdict(
        claim, f"share of the time for which a cell is already finished: {words}", shares[6] < shares[9] < shares[12]
    )


def _mean_over_time(rows: Sequence[Row]) -> float:
    """One minus the mean of search time over time limit, where an unfinished cell counts as the limit."""
    times = [(row[f"search_time_s.{cell}"], float(row["duration_s"])) for row in rows for cell in ("1", "2")]
    return 1.0 - sum(limit if time is None else time for time, limit in times) / sum(limit for _, limit in times)


def fig7_claims(rows: Sequence[Row], bounds: Bounds) -> list[Verdict]:
    """Claims on Fig. 7 [paper 8.4]."""
    rows = usable(rows)
    return [
        _saturates(rows, bounds),
        _falls(rows),
        _ordered(rows),
        _until_r_low(rows, bounds),
        _not_below_r_low(rows, bounds),
    ]


def _means(rows: Sequence[Row]) -> dict[tuple[int, float], float]:
    """Mean search time by (N, r_t), where every run finished."""
    points = sorted({(row["robots"], row["radius_m"]) for row in rows})
    times = {point: [row[ALL] for row in rows if (row["robots"], row["radius_m"]) == point] for point in points}
    return {point: estimate(values).mean for point, values in times.items() if None not in values}


def _saturates(rows: Sequence[Row], bounds: Bounds) -> Verdict:
    """From 35 m on every mean is within 15 % of the middle of T_low."""
    claim = "when r_t exceeds about 30 m, T approaches T_low regardless of N"
    far = {point for point in {(row["robots"], row["radius_m"]) for row in rows} if point[1] >= 35}
    if not far:
        return Verdict(claim, "", None)
    means = {point: mean for point, mean in _means(rows).items() if point in far}
    unfinished = len(far) - len(means)
    words = f"{min(means.values()):.0f} to {max(means.values()):.0f} s from 35 m on" if means else "nothing finished"
    found = f"{words}, T_low {bounds.t_low_mid_s:.0f} s" + (
        f"; {unfinished} points with unfinished runs" * bool(unfinished)
    )
    low_s = bounds.t_low_mid_s
    return Verdict(claim, found, not unfinished and all(abs(mean - low_s) <= 0.15 * low_s for mean in means.values()))


def _falls(rows: Sequence[Row]) -> Verdict:
    """For each N, the rank correlation of T with r_t is below -0.8."""
    claim = "as r_t falls below 30 m, T gradually increases"
    means = _means(rows)
    ranks = {}
    for robots in sorted({n for n, _ in means}):
        curve = [(r, mean) for (n, r), mean in means.items() if n == robots]
        if len(curve) >= 4:
            radii, times = zip(*curve, strict=True)
            ranks[robots] = float(spearmanr(radii, times).statistic)
    if not ranks:
        return Verdict(claim, "", None)
    words = ", ".join(f"{rank:.2f} for N = {n}" for n, rank in ranks.items())
    return Verdict(claim, f"rank correlation of T with r_t: {words}", max(ranks.values()) < -0.8)


def _ordered(rows: Sequence[Row]) -> Verdict:
    """Below 30 m, more robots are faster, at every radius at which two fleets finished all runs."""
    claim = "and a difference between N appears: r_t possibly compensates for the lack of robots"
    means = _means(rows)
    pairs = [
        (means[small, r], mean) for (n, r), mean in means.items() for small, q in means if q == r < 30 and small < n
    ]
    if not pairs:
        return Verdict(claim, "", None)
    right = sum(slower > faster for slower, faster in pairs)
    return Verdict(
        claim, f"the larger fleet is faster in {right} of {len(pairs)} pairs below 30 m", right == len(pairs)
    )


def _until_r_low(rows: Sequence[Row], bounds: Bounds) -> Verdict:
    """At every radius at least 10 % above r_low of its N, at least 9 of 10 runs finish."""
    claim = "until r_t approaches r_low of each N, reconnaissance into all cells is possible within a reasonable time"
    above = [row for row in rows if row["radius_m"] >= 1.1 * bounds.r_low_m(row["robots"])]
    if not above:
        return Verdict(claim, "", None)
    done = [row[ALL] for row in above if row[ALL] is not None]
    found = f"{len(done)} of {len(above)} runs finish from 1.1 r_low on" + (
        f", in {max(done):.0f} s at most" if done else ""
    )
    return Verdict(claim, found, len(done) >= 0.9 * len(above))


def _not_below_r_low(rows: Sequence[Row], bounds: Bounds) -> Verdict:
    """No run finishes with r_t below r_low."""
    claim = "r_low is the lower bound of r_t"
    below = [row for row in rows if row["radius_m"] < bounds.r_low_m(row["robots"])]
    if not below:
        return Verdict(claim, "", None)
    done = sum(row[ALL] is not None for row in below)
    return Verdict(claim, f"{done} of {len(below)} runs below r_low finish", done == 0)
