"""What became of scan reports: which are lost, how old they were when they came, and which of them a fault delayed.

The world knows which reports robots made, and when; the monitor station knows which of them it has, and since when.
Neither knows both, so this module joins them after the run. The final verdict on a fault is that of the world with the
fate of the reports that the fault delayed.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bus.nodes import target_name
from world.faults import describe, parse_fault
from world.feed import Event
from world.terms import NOBODY, STATION, seconds_of, tick_of

__all__ = ["foreign_reports", "information_age", "lost_reports", "settle", "verdict_on"]


def verdict_on(of: int | str, events: Sequence[Event]) -> Callable[[Mapping[str, Any]], bool]:
    """Whether a verdict of the world is on a fault that struck a node, or on a certain fault.

    Args:
        of: the node (4, "station"), or the fault in the form of the command line, with its target as asked for
            ("relay:mid") or as resolved.
        events: of the run; more of them may come in later.

    Raises:
        ValueError: `of` is neither.
    """
    if isinstance(of, int) or of == "station":
        node = STATION if of == "station" else of
        return lambda verdict: bool(verdict["robot"] == node)
    fault = parse_fault(of)
    fault = dataclasses.replace(fault, at_s=seconds_of(tick_of(fault.at_s)))
    name = describe(fault)

    def is_on(verdict: Mapping[str, Any]) -> bool:
        struck = [event.node for event in events if event.kind == "fault" and event.data.get("asked") == name]
        resolved = [describe(dataclasses.replace(fault, target=target_name(node))) for node in struck if node != NOBODY]
        return verdict["fault"] in (name, *resolved)

    return is_on


def settle(
    recoveries: Sequence[Mapping[str, Any]],
    acknowledged: Mapping[str, Sequence[int]],
    complete: Mapping[str, int] | None,
) -> list[dict[str, Any]]:
    """Add to each verdict the fate of the scan reports that the orphans of the fault made while they were cut off.

    Args:
        recoveries: the world's verdicts.
        acknowledged: of each robot that lives at the end: its incarnation, and the highest report of which it was
            told that the MS has it.
        complete: of each robot incarnation ("4/0"): the highest report that the MS has without a gap; None if the
            MS did not live to tell, which leaves all counts None.

    Returns:
        The verdicts with `scan_reports`: `delayed` (delivered later), `pending` (still with their living robot),
        `dead` (gone with their robot), `lost` (neither with the MS nor with their living robot: a defect),
        `discarded` (never made, by the rule `store_and_forward = false`).
    """
    return [dict(verdict) | {"scan_reports": _fate(verdict, acknowledged, complete)} for verdict in recoveries]


def lost_reports(acknowledged: Mapping[str, Sequence[int]], station: Mapping[str, Any]) -> int:
    """Scan reports that are neither on the map nor with their living robot: 0 unless there is a defect.

    The MS may never have got them, or have taken something else under their number.

    Args:
        acknowledged: as for `settle`.
        station: its last counts.
    """
    complete: Mapping[str, int] = station["complete"]
    never = sum(
        max(0, upto - complete.get(f"{robot}/{incarnation}", 0)) for robot, (incarnation, upto) in acknowledged.items()
    )
    return never + int(station["contradicted"])


def foreign_reports(made: Mapping[str, int], station: Mapping[str, Any]) -> int:
    """Scan reports that are on the map, but that no robot made: 0 unless a robot sends in the name of another.

    Args:
        made: of each robot incarnation ("4/0"): how many reports it made, by its own count.
        station: its last counts.
    """
    complete: Mapping[str, int] = station["complete"]
    ahead: Mapping[str, Sequence[int]] = station["ahead"]
    beyond = sum(max(0, number - made.get(source, 0)) for source, number in complete.items())
    return beyond + sum(number > made.get(source, 0) for source, numbers in ahead.items() for number in numbers)


def information_age(
    scan_ticks: Mapping[str, Sequence[int]], merged_ticks: Mapping[str, Sequence[Sequence[int]]]
) -> dict[str, float | None]:
    """Quantiles, over all reports that robots made, of the time from the scan until the MS had merged its report.

    Args:
        scan_ticks: of each robot incarnation ("4/0"): tick of the scan that each of its reports shows, in their order.
        merged_ticks: of each: numbers of its reports, which begin with 1, and the ticks at which they were merged.

    Returns:
        `median_s` and `p95_s`. A report that never came is older than all others, so either is None if it falls on one,
        or if there is no report.
    """
    ages = sorted(
        max(merged - scan_ticks[source][number - 1], 0)
        for source, reports in merged_ticks.items()
        for number, merged in reports
        if number <= len(scan_ticks.get(source, ()))
    )
    made = sum(map(len, scan_ticks.values()))
    return {"median_s": _quantile_s(ages, 0.5, made), "p95_s": _quantile_s(ages, 0.95, made)}


def _quantile_s(ages: Sequence[int], share: float, of: int) -> float | None:
    """The least age that at least this share of the reports did not exceed."""
    rank = max(math.ceil(share * of), 1) - 1
    return seconds_of(ages[rank]) if rank < len(ages) else None


def _fate(
    verdict: Mapping[str, Any], acknowledged: Mapping[str, Sequence[int]], complete: Mapping[str, int] | None
) -> dict[str, int | None]:
    count: Counter[str] = Counter(delayed=0, pending=0, dead=0, lost=0, discarded=0)
    for orphan in verdict["orphans"]:
        robot, incarnation = orphan["robot"], orphan["incarnation"]
        first = orphan["reports_before"] + 1
        last = orphan["reports_before"] + orphan["reports_made"]
        arrived = min(last, (complete or {}).get(f"{robot}/{incarnation}", 0))
        there = arrived
        alive = acknowledged.get(str(robot))
        if alive is not None and alive[0] == incarnation:
            # Reports up to alive[1] are no longer with the robot, since it believes that the MS has them.
            there = max(arrived, min(last, alive[1]))
            count["pending"] += _between(max(first, there + 1), last)
            count["lost"] += _between(max(first, arrived + 1), there)
        else:
            count["dead"] += _between(max(first, arrived + 1), last)
        count["delayed"] += _between(first, arrived)
        count["discarded"] += orphan["reports_discarded"]
    return dict.fromkeys(count) if complete is None else dict(count)


def _between(first: int, last: int) -> int:
    return max(0, last - first + 1)
