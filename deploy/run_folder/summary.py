"""summary.json: how a run ended, from the last counts of its processes and from the snapshots (docs/summary.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from deploy.run_folder.status import meaning_of
from deploy.run_folder.verdicts import foreign_reports, information_age, lost_reports, settle
from monitor_station.config import FINISHED
from world.connectivity import Connectivity
from world.feed import Snapshot
from world.terms import UNREACHABLE, Cls, seconds_of

if TYPE_CHECKING:
    from deploy.run_folder.baseline import Baseline
    from deploy.scenario import Scenario

__all__ = ["Finals", "Progress", "compare", "remainder", "shortfall", "summary_of"]

Finals = Mapping[str, Mapping[str, Any]]
"""Last counts by process: `world`, `medium`, `station`; and `phases`."""


class Progress:
    """Counts from snapshots. They replace the last counts of a process that was lost."""

    def __init__(self, cells: Sequence[str]) -> None:
        self.latest: Snapshot | None = None
        """The last snapshot."""
        self.connectivity = Connectivity()
        self.search_rate = dict.fromkeys(cells, 0.0)
        """By search cell."""
        self.search_time_s: dict[str, float | None] = dict.fromkeys([*cells, "all"], None)
        """By search cell, and for `all`; None while it is not searched."""
        self._cells = cells

    def add(self, s: Snapshot) -> None:
        """Add a tick, in the order of ticks; some may be missing."""
        unchanged = self.latest is not None and s.search_rate == self.latest.search_rate
        self.latest = s
        self.connectivity.add(s)
        if unchanged:
            return
        now_s = seconds_of(s.tick)
        for name, rate in zip(self._cells, s.search_rate, strict=False):
            self.search_rate[name] = rate
            if rate >= 1.0 and self.search_time_s[name] is None:
                self.search_time_s[name] = now_s
        if self.search_time_s["all"] is None and all(rate >= 1.0 for rate in self.search_rate.values()):
            self.search_time_s["all"] = now_s

    @property
    def ticks(self) -> int:
        return 0 if self.latest is None else self.latest.tick + 1


def summary_of(
    scenario: Scenario, progress: Progress, finals: Finals, wall_s: float, status: str | None
) -> dict[str, Any]:
    """The summary.

    Args:
        scenario: of the run.
        progress: after the last snapshot.
        finals: where those of a process are missing, the summary has what the snapshots tell, or null.
        wall_s: how long the run took.
        status: replaces the status of the world, as when the world was lost.
    """
    world, medium, station = (finals.get(name, {}) for name in ("world", "medium", "station"))
    latest = progress.latest
    ticks = world.get("ticks", progress.ticks)
    simulated_s = seconds_of(ticks)
    return {
        "status": status or world.get("status", "failed"),
        "scenario": scenario.name,
        "seed": scenario.seed,
        "robots": scenario.robots,
        "external_robots": list(scenario.external),
        "radius_m": scenario.radius_m,
        "unreachable": {
            "floor": round(scenario.arena.unreachable, 6),
            "cells": dict(zip(scenario.cell_names, (round(s, 6) for s in scenario.arena.unreachable_of), strict=True)),
        },
        "simulated_s": simulated_s,
        "wall_s": round(wall_s, 3),
        "real_time_factor": round(simulated_s / wall_s, 2) if wall_s > 0 else None,
        "ticks": ticks,
        "trace_sha256": medium.get("trace_sha256"),
        "search_rate": station.get("search_rate", progress.search_rate),
        "search_time_s": station.get("search_time_s", progress.search_time_s),
        "known_free": station.get("known_free"),
        "map_errors": station.get("map_errors"),
        "left": station.get("left"),
        "connected_fraction": world.get("connected_fraction", progress.connectivity.fraction if latest else None),
        "longest_absence_s": world.get(
            "longest_absence_s", progress.connectivity.longest_absence_s if latest else None
        ),
        "max_hops": world.get("max_hops", progress.connectivity.max_hops),
        "planned_absences": world.get("planned_absences", progress.connectivity.planned_absences if latest else None),
        "blocked_moves": world.get("blocked_moves"),
        "walked_m": world.get("walked_m"),
        "information_age": _age(world, station),
        "scan_reports": _scan_reports(world, station, latest),
        "victims": {
            "placed": len(scenario.arena.victims_m),
            "found": sum(
                victim < len(scenario.arena.victims_m)
                for victim in station.get("victims_found", latest.victims_found if latest else ())
            ),
        },
        "robots_at_end": [] if latest is None else _robots(latest),
        "frames": medium.get("frames"),
        "faults": world.get("faults", []),
        "wall_clock_faults": world.get("wall_clock_faults"),
        "recoveries": settle(
            world.get("recoveries", []), world.get("acknowledged", {}), station.get("complete") if station else None
        ),
        "tick_ms": world.get("tick_ms"),
        "tick_blame": world.get("tick_blame"),
        "tick_phases": _phases_ms(finals.get("phases"), ticks),
        "ticked_unix_s": world.get("ticked_unix_s"),
        "why": world.get("why"),
    }


def shortfall(summary: Mapping[str, Any]) -> str | None:
    """One line on a run that ended for want of something: a process, robots, frontiers; None if it ended as asked."""
    finished = (summary.get("known_free") or {}).get("share", 0.0) >= FINISHED
    if meaning_of(summary["status"]).as_asked or (summary["status"] == "exhausted" and finished):
        return None
    words = f"the run ended at {summary['simulated_s']:.1f} s: {summary['why'] or summary['status']}"
    return f"{words}; {remainder(summary)}" if summary["status"] == "exhausted" else words


def remainder(summary: Mapping[str, Any]) -> str:
    """What of the search cells is not known to be free, and why; empty if nothing is left or nobody knows."""
    share, left = summary.get("known_free"), summary.get("left")
    if share is None or left is None or not left["unknown"] + left["called_wall"]:
        return ""
    frontiers = left["frontiers"]
    way = f"a path leads to {frontiers} cells beside unknown ones" if frontiers else "no path leads to what is unknown"
    return (
        f"{share['share']:.2%} of what can be searched is known to be free; the map shows {left['called_wall']} of the "
        f"other cells as wall and {left['unknown']} as unknown, and {way}"
    )


def compare(summary: dict[str, Any], baseline: Baseline) -> None:
    """Add the search time that the faults cost. Of several faults only the sum is known."""
    lost_s = baseline.lost_s(summary["search_time_s"])
    summary["compared_with"] = str(baseline.folder)
    summary["search_time_lost_s"] = lost_s
    verdicts = summary["recoveries"]
    for verdict in verdicts:
        verdict["search_time_lost_s"] = lost_s if len(verdicts) == 1 else None


def _scan_reports(
    world: Mapping[str, Any], station: Mapping[str, Any], latest: Snapshot | None
) -> dict[str, int | None]:
    merged = station.get("merged", None if latest is None else latest.merged)
    lost = foreign = None
    if "acknowledged" in world and "complete" in station:
        lost = lost_reports(world["acknowledged"], station)
        foreign = foreign_reports(world["made"], station)
    told = world.get("scan_reports", {})
    counts = {"made": None, "buffered": None, "discarded": None, **told}
    return counts | {"merged": merged, "lost": lost, "foreign": foreign}


def _age(world: Mapping[str, Any], station: Mapping[str, Any]) -> dict[str, float | None]:
    """Nulls if the world or the station was lost."""
    known = "scan_ticks" in world and "merged_ticks" in station
    return information_age(world["scan_ticks"], station["merged_ticks"]) if known else {"median_s": None, "p95_s": None}


def _robots(s: Snapshot) -> list[dict[str, Any]]:
    """True position and route of each robot."""
    return [
        {
            "robot": int(s.nodes[row]),
            "x_m": round(float(s.xy_m[row, 0]), 2),
            "y_m": round(float(s.xy_m[row, 1]), 2),
            "present": bool(s.present[row]),
            "class": Cls(int(s.cls[row])).name,
            "hops": None if s.hops[row] == UNREACHABLE else int(s.hops[row]),
            "nms": None if s.nms[row] < 0 else int(s.nms[row]),
        }
        for row in range(len(s.nodes))
    ]


def _phases_ms(spent_s: Mapping[str, Mapping[str, float]] | None, ticks: int) -> dict[str, dict[str, float]] | None:
    """Milliseconds per tick of the run, by process and phase."""
    if not spent_s or not ticks:
        return None
    return {
        process: {phase: round(seconds * 1e3 / ticks, 4) for phase, seconds in sorted(phases.items())}
        for process, phases in sorted(spent_s.items())
    }
