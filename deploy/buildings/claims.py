"""What the policies are to show on buildings, judged by the rows of the study `buildings`; the thresholds are ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Final

__all__ = ["ASKED", "T100", "Verdict", "buildings_claims", "time_s"]

T100: Final = "known_free.t100_s"

Row = Mapping[str, Any]

MAPS: Final = ("hospital_025", "warehouse_050")
PLANS: Final = ("hospital_ward", "warehouse", "office_20_rooms", "tunnels", "cluttered_room")
HOSPITAL: Final = MAPS[:1]
BODIES: Final = "sortie, walls block, bodies"
SEEDS: Final = 10

ASKED: Final[Mapping[str, Sequence[str]]] = {
    "sortie, 18 dB": (*MAPS, *PLANS),
    "sortie, walls block": (*MAPS, *PLANS),
    BODIES: (*MAPS, *PLANS),
    "scout, walls block": HOSPITAL,
    "scout, disk": HOSPITAL,
    "scout, disk, noise": HOSPITAL,
    "scout, disk, 20 kB/s": HOSPITAL,
}
"""Variants, and the buildings on which the claims need them."""


@dataclass(frozen=True)
class Verdict:
    """One claim, which says its own rule, and what decides it."""

    claim: str
    found: str
    holds: bool | None
    """None: too few missions have been run to judge it."""

    @property
    def word(self) -> str:
        return {True: "holds", False: "does not hold", None: "open"}[self.holds]


def time_s(row: Row, time: str = T100) -> float:
    """T50, T90 or T100 of a mission; of one that did not get there, its time limit, at which it is censored."""
    value = row[time]
    return float(row["duration_s"] if value is None else value)


def buildings_claims(rows: Sequence[Row]) -> list[Verdict]:
    """All claims. One whose missions have not all been run yet is open, unless those that were run decide it."""
    cells = {
        (variant, building): [r for r in rows if (r["variant"], r["scenario"]) == (variant, building)]
        for variant, buildings in ASKED.items()
        for building in buildings
    }
    verdicts = [
        _finish(variant, building, cells[variant, building], SEEDS)
        for variant in ("sortie, 18 dB", "sortie, walls block")
        for building in ASKED[variant]
    ]
    hospital = HOSPITAL[0]
    verdicts.append(_times("sortie, walls block", "scout, walls block", hospital, cells, 0.5))
    for building in ASKED[BODIES]:
        verdicts.append(_finish(BODIES, building, cells[BODIES, building], SEEDS - 1))
        verdicts.append(_times(BODIES, "sortie, walls block", building, cells, 1.5))
    for variant, most in (("scout, disk, noise", 1.3), ("scout, disk, 20 kB/s", 1.5)):
        verdicts.append(_finish(variant, hospital, cells[variant, hospital], SEEDS))
        verdicts.append(_times(variant, "scout, disk", hospital, cells, most))
    verdicts.append(_false_walls(cells["scout, disk, noise", hospital]))
    verdicts.append(_unacknowledged(cells["scout, disk, 20 kB/s", hospital]))
    return verdicts


def _finish(variant: str, building: str, rows: Sequence[Row], asked: int) -> Verdict:
    claim = f"`{building}`, {variant}: {asked} of {SEEDS} finish"
    if not rows:
        return Verdict(claim, "", None)
    failed = [int(row["seed"]) for row in rows if row[T100] is None]
    found = f"{len(rows) - len(failed)} of {len(rows)}"
    if failed:
        found += f"; not seed {', '.join(map(str, failed))}"
    return Verdict(claim, found, _judged(rows, good=len(failed) <= SEEDS - asked, early=len(failed) > SEEDS - asked))


def _times(
    variant: str, other: str, building: str, cells: Mapping[tuple[str, str], Sequence[Row]], most: float
) -> Verdict:
    claim = f"`{building}`, {variant}: median T100 at most {most:g} of that of {other}"
    ours, theirs = ([time_s(row) for row in cells[name, building]] for name in (variant, other))
    if not ours or not theirs:
        return Verdict(claim, "", None)
    our_s, their_s = median(ours), median(theirs)
    ratio = our_s / their_s
    seeds = f"{len(ours)} and {len(theirs)} seeds"
    found = f"{our_s:.0f} s to {their_s:.0f} s, {ratio:.2f} ({seeds})"
    return Verdict(claim, found, ratio <= most if min(len(ours), len(theirs)) >= SEEDS else None)


def _false_walls(rows: Sequence[Row]) -> Verdict:
    claim = f"`{HOSPITAL[0]}`, scout, disk, noise: less than 0.5 % of the free floor is called wall"
    worst = max((row["map_errors.free_called_wall"] for row in rows), default=None)
    if worst is None:
        return Verdict(claim, "", None)
    return Verdict(claim, f"{worst:.2%} at most, {len(rows)} seeds", _judged(rows, worst < 0.005, worst >= 0.005))


def _unacknowledged(rows: Sequence[Row]) -> Verdict:
    """A run ends in the tick in which the MS knows everything, so the last reports of each robot are on their way."""
    claim = f"`{HOSPITAL[0]}`, scout, disk, 20 kB/s: no report waits at the end but the last of each robot"
    worst = max((int(row["scan_reports.buffered"] - row["robots"]) for row in rows), default=None)
    if worst is None:
        return Verdict(claim, "", None)
    most = max(int(row["scan_reports.buffered"]) for row in rows)
    found = f"{most} at most, of {int(rows[0]['robots'])} robots, {len(rows)} seeds"
    return Verdict(claim, found, _judged(rows, worst <= 0, worst > 0))


def _judged(rows: Sequence[Row], good: bool, early: bool) -> bool | None:
    """The verdict once all seeds have been run; before, only that it can't hold any more."""
    return good if len(rows) >= SEEDS else False if early else None
