"""The claims of the paper's text on its Fig. 6 and 7 [paper 8.3, 8.4], judged by the results of the studies.

The text has words only, so the rules are ours. Each verdict says by which rule the claim would have failed. Runs that
did not finish are censored at their time limit; none is left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from deploy.sweep.bounds import Bounds
from deploy.sweep.plan import Discard
from deploy.sweep.statistics import ALL, Censored, censored, censored_s, kept, usable

__all__ = ["Outcome", "Verdict", "fig6_claims", "fig7_claims"]

Row = Mapping[str, Any]
SeriesByKey = Mapping[str, Mapping[str, Sequence[float]]]
Point = tuple[int, float]
"""N and r_t."""

SATURATED_FROM_M: Final = 30.0
"""The paper's "about 30 m"."""
_REASONABLE: Final = 10.0
"""A search time is reasonable up to so many times T_low."""


class Outcome(Enum):
    """What became of a claim."""

    HOLDS = "holds"
    IN_PART = "holds in part"
    NOT = "does not hold"
    UNMEASURED = "not measured"

    @staticmethod
    def of(whole: bool, part: bool) -> Outcome:
        """By whether all of it is so, and whether some of it is."""
        return Outcome.HOLDS if whole else Outcome.IN_PART if part else Outcome.NOT


@dataclass(frozen=True)
class Verdict:
    """One claim and its verdict."""

    claim: str
    found: str
    """The numbers that decide."""
    rule: str
    """By which it holds, holds in part, or fails."""
    outcome: Outcome = Outcome.UNMEASURED

    @property
    def word(self) -> str:
        return self.outcome.value


def fig6_claims(rows: Sequence[Row], series: SeriesByKey, discard: Discard | None) -> list[Verdict]:
    """Claims on Fig. 6 [paper 8.3], on the runs that the study's rule keeps; of N = 6 on all runs as well."""
    whole = {n: [row for row in usable(rows) if row["robots"] == n] for n in (6, 9, 12)}
    fleets = {n: kept(of_fleet, series, discard) for n, of_fleet in whole.items()}
    return [_one_after_the_other(fleets[12]), _hardly(fleets[6], whole[6]), _intermediate(fleets)]


def _end_rates(rows: Sequence[Row]) -> tuple[float, float]:
    """Mean search rates of cells 1 and 2 at the end of the runs."""
    first, second = (sum(row[f"search_rate.{cell}"] for row in rows) / len(rows) for cell in ("1", "2"))
    return first, second


def _one_after_the_other(rows: Sequence[Row]) -> Verdict:
    claim = "N = 12: reconnaissance of cell 1 is accomplished first, then the chain transforms to cell 2"
    rule = "holds if 90 % of the kept runs finish both cells, and 1 before 2; in part if half of them do"
    if not rows:
        return Verdict(claim, "", rule)
    pairs = [(row["search_time_s.1"], row["search_time_s.2"]) for row in rows]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    ordered = sum(a < b for a, b in both)
    first, second = (censored(rows, f"search_time_s.{cell}").mean_s.value for cell in ("1", "2"))
    found = f"{len(both)} of {len(rows)} runs finish both, {ordered} in that order: {first:.0f} s, then {second:.0f} s"
    return Verdict(claim, found, rule, Outcome.of(ordered >= 0.9 * len(rows), ordered >= 0.5 * len(rows)))


def _hardly(rows: Sequence[Row], everything: Sequence[Row]) -> Verdict:
    claim = "N = 6: a cell is not accomplished in one time, and the search rate for either cell hardly increases"
    rule = (
        "holds if no run, kept or not, finishes a cell, and neither cell's mean over all of them reaches 25 %; in part "
        "if that is so of the kept runs alone. That the chain changes its corridor again and again is not judged"
    )
    if not rows:
        return Verdict(claim, "", rule)
    words, hardly = [], []
    for name, of_them in (("kept", rows), ("all", everything)):
        ends = _end_rates(of_them)
        finished = sum(any(row[f"search_time_s.{cell}"] is not None for cell in ("1", "2")) for row in of_them)
        words.append(
            f"{name}: {finished} of {len(of_them)} finish a cell, {ends[0]:.0%} and {ends[1]:.0%} at the limit"
        )
        hardly.append(finished == 0 and max(ends) < 0.25)
    return Verdict(claim, "; ".join(words), rule, Outcome.of(all(hardly), hardly[0]))


def _intermediate(fleets: Mapping[int, Sequence[Row]]) -> Verdict:
    claim = "N = 9 is the intermediate case"
    rule = (
        "of the share of the time for which a cell is already finished: holds if N = 9 is 10 points or more above "
        "N = 6 and below N = 12; in part if it is only between them"
    )
    if not all(fleets.values()):
        return Verdict(claim, "", rule)
    shares = {n: _mean_over_time(left) for n, left in fleets.items()}
    words = ", ".join(f"{share:.0%} for N = {n}" for n, share in sorted(shares.items()))
    gaps = shares[9] - shares[6], shares[12] - shares[9]
    return Verdict(claim, words, rule, Outcome.of(min(gaps) >= 0.1, min(gaps) > 0.0))


def _mean_over_time(rows: Sequence[Row]) -> float:
    """One minus the mean of min(search time, limit) over the limit, of both cells."""
    times_s = sum(censored_s(row, f"search_time_s.{cell}") for row in rows for cell in ("1", "2"))
    return 1.0 - times_s / (2.0 * sum(float(row["duration_s"]) for row in rows))


def fig7_claims(rows: Sequence[Row], bounds: Bounds) -> list[Verdict]:
    """Claims on Fig. 7 [paper 8.4]."""
    rows = usable(rows)
    points = sorted({(row["robots"], row["radius_m"]) for row in rows})
    times = {point: censored([row for row in rows if (row["robots"], row["radius_m"]) == point]) for point in points}
    return [
        _saturates(times, bounds),
        _falls(times),
        _ordered(times),
        _reasonable(rows, times, bounds),
        _least_radius(times, bounds),
    ]


def _curves(times: Mapping[Point, Censored]) -> dict[int, list[tuple[float, Censored]]]:
    """By N: radii, ascending, with their times."""
    return {
        robots: [(radius_m, found) for (n, radius_m), found in sorted(times.items()) if n == robots]
        for robots in sorted({n for n, _ in times})
    }


def _saturates(times: Mapping[Point, Censored], bounds: Bounds) -> Verdict:
    claim = "when r_t exceeds about 30 m, T approaches T_low regardless of N"
    rule = (
        f"holds if from {SATURATED_FROM_M:g} m on every mean is at most 20 % above T_low; in part if all N are at the "
        "largest r_t"
    )
    far = {point: found for point, found in times.items() if point[1] >= SATURATED_FROM_M}
    if not far:
        return Verdict(claim, "", rule)
    above = {point: found.mean_s.value / bounds.t_low_s - 1.0 for point, found in far.items()}
    largest_m = max(radius_m for _, radius_m in far)
    at_most = {r: max(share for (_, q), share in above.items() if q == r) for r in sorted({r for _, r in far})}
    words = ", ".join(f"{share:+.0%} at {radius_m:g} m" for radius_m, share in at_most.items())
    found = f"T_low {bounds.t_low_s:.0f} s; the slowest N against it: {words}"
    return Verdict(claim, found, rule, Outcome.of(max(at_most.values()) <= 0.2, at_most[largest_m] <= 0.2))


def _falls(times: Mapping[Point, Censored]) -> Verdict:
    claim = "as r_t falls below 30 m, T gradually increases"
    rule = (
        "holds if for each N, from 30 m down to where runs stop finishing, no step to the next smaller r_t lowers the "
        "mean by more than 10 % or more than doubles it; in part if the mean at least rises in all"
    )
    steps: list[float] = []
    risen, words = [], []
    for robots, curve in _curves(times).items():
        means = [found.mean_s.value for radius_m, found in curve if radius_m <= SATURATED_FROM_M and found.finished]
        if len(means) < 3:
            continue
        ratios = [small / large for small, large in itertools.pairwise(means)]
        steps += ratios
        risen.append(means[0] > means[-1])
        words.append(f"{min(ratios):.2f} to {max(ratios):.2f} a step for N = {robots}")
    if not steps:
        return Verdict(claim, "", rule)
    return Verdict(claim, ", ".join(words), rule, Outcome.of(min(steps) >= 0.9 and max(steps) <= 2.0, all(risen)))


def _ordered(times: Mapping[Point, Censored]) -> Verdict:
    claim = "and a difference between N appears: r_t possibly compensates for the lack of robots"
    rule = (
        "holds if below 30 m the larger of two fleets is faster at every r_t at which a run of either finishes; in "
        "part if it is in 80 % of these pairs"
    )
    pairs = [
        (slower.mean_s.value, faster.mean_s.value)
        for (small, r), slower in times.items()
        for (large, q), faster in times.items()
        if q == r < SATURATED_FROM_M and small < large and slower.finished + faster.finished
    ]
    if not pairs:
        return Verdict(claim, "", rule)
    right = sum(slower > faster for slower, faster in pairs)
    found = f"the larger fleet is faster in {right} of {len(pairs)} pairs"
    return Verdict(claim, found, rule, Outcome.of(right == len(pairs), right >= 0.8 * len(pairs)))


def _least_finishing_m(times: Mapping[Point, Censored]) -> dict[int, float]:
    """By N: the smallest r_t at which a run finished."""
    curves = _curves(times)
    least = {n: [radius_m for radius_m, found in curve if found.finished] for n, curve in curves.items()}
    return {n: radii[0] for n, radii in least.items() if radii}


def _reasonable(rows: Sequence[Row], times: Mapping[Point, Censored], bounds: Bounds) -> Verdict:
    claim = "until r_t approaches r_low of each N, reconnaissance into all cells is possible within a reasonable time"
    rule = (
        f"holds if every run from the smallest r_t on at which one of its N finishes takes {_REASONABLE:g} T_low at "
        "most; in part if 90 % of them do"
    )
    least_m = _least_finishing_m(times)
    above = [row for row in rows if row["radius_m"] >= least_m.get(row["robots"], float("inf"))]
    if not above:
        return Verdict(claim, "", rule)
    limit_s = _REASONABLE * bounds.t_low_s
    done = sum(row[ALL] is not None and row[ALL] <= limit_s for row in above)
    slowest_s = max(censored_s(row) for row in above)
    found = f"{done} of {len(above)} runs take {limit_s:.0f} s at most; the slowest {slowest_s:.0f} s"
    return Verdict(claim, found, rule, Outcome.of(done == len(above), done >= 0.9 * len(above)))


def _least_radius(times: Mapping[Point, Censored], bounds: Bounds) -> Verdict:
    claim = "r_low is the lower bound of r_t"
    rule = (
        "of the least r_t with which the study's radio lets a chain of N robots see every place: holds if no run below "
        "it finishes, and for each N one does within 10 % above it; in part if only the first is so"
    )
    least_m = _least_finishing_m(times)
    fleets = sorted(n for n in least_m if n in bounds.radio_m)
    if not fleets:
        return Verdict(claim, "", rule)
    words = ", ".join(
        f"N = {n}: {bounds.radio_m[n]:.1f} m ({bounds.corridor_m(n):.1f} m along the corridor), "
        f"runs finish from {least_m[n]:g} m on"
        for n in fleets
    )
    bounded = all(least_m[n] >= bounds.radio_m[n] for n in fleets)
    tight = all(least_m[n] <= 1.1 * bounds.radio_m[n] for n in fleets)
    return Verdict(claim, words, rule, Outcome.of(bounded and tight, bounded))
