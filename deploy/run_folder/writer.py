"""What a run leaves: summary.json, metrics.csv, events.jsonl and scenario.toml in one folder.

Fed with the world's snapshots and events by whoever runs the cores, in one process or in many. The keys of the
summary are documented in docs/summary.md.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from deploy.run_folder.verdicts import lost_reports, settle
from world.feed import Event, Snapshot
from world.terms import TICK_S, UNREACHABLE, Cls, seconds_of

if TYPE_CHECKING:
    from deploy.run_folder.baseline import Baseline
    from deploy.scenario import Scenario

__all__ = ["RunFolder"]

_TICKS_PER_ROW: Final = round(1 / TICK_S)


class RunFolder:
    """The files of one run; a context manager that closes them."""

    def __init__(self, path: Path, scenario: Scenario, baseline: Baseline | None = None) -> None:
        """Create the folder and its first files; the summary compares the run with `baseline`.

        Raises:
            OSError: the folder can't be made or written.
        """
        path.mkdir(parents=True, exist_ok=True)
        self.path = path
        self.latest: Snapshot | None = None
        """The last snapshot seen."""
        self._scenario = scenario
        self._baseline = baseline
        self._progress = _Progress(scenario.cell_names)
        (path / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
        # What an earlier run left in a folder that is used again must not pass for this one's.
        for pattern in ("summary.json", "recording*.rrd", "journal", "map.yaml", "map.pgm", "logs/*.log"):
            for old in path.glob(pattern):
                old.unlink()
        self._metrics_file = (path / "metrics.csv").open("w", newline="", encoding="utf-8")
        self._metrics = csv.writer(self._metrics_file)
        self._metrics.writerow([*_COLUMNS, *(f"search_rate_{name}" for name in scenario.cell_names)])
        self._events = (path / "events.jsonl").open("w", buffering=1, encoding="utf-8")

    def snapshot(self, snapshot: Snapshot) -> None:
        """Take one tick in, in the order of ticks; some may be missing."""
        before = -1 if self.latest is None else self.latest.tick // _TICKS_PER_ROW
        self.latest = snapshot
        self._progress.add(snapshot)
        if snapshot.tick // _TICKS_PER_ROW > before:
            self._metrics.writerow(_row(snapshot))

    def event(self, event: Event) -> None:
        """Write one line of events.jsonl."""
        line = {
            "tick": event.tick,
            "at_s": seconds_of(event.tick),
            "kind": event.kind,
            "node": event.node,
            "text": event.text,
            "data": event.data,
        }
        self._events.write(json.dumps(line) + "\n")

    def finish(
        self,
        finals: Mapping[str, Mapping[str, Any]],
        wall_s: float,
        *,
        status: str | None = None,
        failures: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Write the summary and return it.

        Args:
            finals: last counts of `world`, `medium` and `station`; one that is missing leaves nulls.
            wall_s: how long the run took.
            status: overrules the world's word, as when the world was lost.
            failures: what went wrong, one line each.
        """
        summary = self._summary(finals, wall_s, status)
        if self._baseline is not None:
            self._compare(summary, self._baseline)
        summary["failures"] = list(failures)
        self.flush()
        draft = self.path / "summary.json.part"
        draft.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
        draft.replace(self.path / "summary.json")
        return summary

    def _summary(self, finals: Mapping[str, Mapping[str, Any]], wall_s: float, status: str | None) -> dict[str, Any]:
        world, medium, station = (finals.get(name, {}) for name in ("world", "medium", "station"))
        scenario, seen = self._scenario, self._progress
        ticks = world.get("ticks", 0 if self.latest is None else self.latest.tick + 1)
        simulated_s = seconds_of(ticks)
        return {
            "status": status or world.get("status", "failed"),
            "scenario": scenario.name,
            "seed": scenario.seed,
            "robots": scenario.robots,
            "radius_m": scenario.radius_m,
            "simulated_s": simulated_s,
            "wall_s": round(wall_s, 3),
            "real_time_factor": round(simulated_s / wall_s, 2) if wall_s > 0 else None,
            "ticks": ticks,
            "trace_sha256": medium.get("trace_sha256"),
            "search_rate": station.get("search_rate", seen.search_rate),
            "search_time_s": station.get("search_time_s", seen.search_time_s),
            "connected_fraction": world.get("connected_fraction", seen.connected_fraction),
            "max_hops": world.get("max_hops", seen.max_hops),
            "scan_reports": self._scan_reports(world, station),
            "victims": {"placed": len(scenario.arena.victims_m), "found": self._victims_found(station)},
            "robots_at_end": [] if self.latest is None else _places(self.latest),
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

    @staticmethod
    def _compare(summary: dict[str, Any], baseline: Baseline) -> None:
        """What the faults cost: with one fault it is that fault's doing, with several only the sum is known."""
        lost_s = baseline.lost_s(summary["search_time_s"])
        summary["compared_with"] = str(baseline.folder)
        summary["search_time_lost_s"] = lost_s
        verdicts = summary["recoveries"]
        for verdict in verdicts:
            verdict["search_time_lost_s"] = lost_s if len(verdicts) == 1 else None

    def _scan_reports(self, world: Mapping[str, Any], station: Mapping[str, Any]) -> dict[str, int | None]:
        told = world.get("scan_reports", {})
        merged = station.get("merged", None if self.latest is None else self.latest.merged)
        lost = None
        if "acknowledged" in world and "complete" in station:
            lost = lost_reports(world["acknowledged"], station["complete"])
        return {"made": None, "buffered": None, "discarded": None, **told, "merged": merged, "lost": lost}

    def _victims_found(self, station: Mapping[str, Any]) -> int:
        known = () if self.latest is None else self.latest.victims_found
        return len(station.get("victims_found", known))

    def flush(self) -> None:
        """Bring everything written so far to disk."""
        for file in (self._metrics_file, self._events):
            file.flush()
            os.fsync(file.fileno())

    def close(self) -> None:
        self._metrics_file.close()
        self._events.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _phases_ms(spent_s: Mapping[str, Mapping[str, float]] | None, ticks: int) -> dict[str, dict[str, float]] | None:
    """Milliseconds per tick of the run, by process and phase."""
    if not spent_s or not ticks:
        return None
    return {
        process: {phase: round(seconds * 1e3 / ticks, 4) for phase, seconds in sorted(phases.items())}
        for process, phases in sorted(spent_s.items())
    }


_COLUMNS: Final = (
    "time_s", "robots_present", "robots_connected", "relays", "max_hops", "mean_hops", "scan_reports_merged",
    "scan_reports_buffered", "victims_found",
)  # fmt: skip


def _row(s: Snapshot) -> list[object]:
    present = s.present == 1
    hops = s.hops[present & (s.hops < UNREACHABLE)]
    return [
        seconds_of(s.tick),
        int(present.sum()),
        len(hops),
        int((present & (s.cls == Cls.RR)).sum()),
        int(hops.max()) if len(hops) else "",
        round(float(hops.mean()), 3) if len(hops) else "",
        s.merged,
        s.reports_buffered,
        len(s.victims_found),
        *(round(rate, 6) for rate in s.search_rate),
    ]


def _places(s: Snapshot) -> list[dict[str, Any]]:
    """Where the robots truly were, and their routes."""
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


class _Progress:
    """What the snapshots alone tell: for runs whose processes could not say it themselves."""

    def __init__(self, cells: Sequence[str]) -> None:
        self._cells = cells
        self._connected = 0
        self._present = 0
        self._rates: tuple[float, ...] | None = None
        self.max_hops = 0
        self.search_rate = dict.fromkeys(cells, 0.0)
        self.search_time_s: dict[str, float | None] = dict.fromkeys([*cells, "all"], None)

    def add(self, s: Snapshot) -> None:
        # For some robots a loop is quicker than numpy.
        hops = [hops for here, hops in zip(s.present.tolist(), s.hops.tolist(), strict=True) if here]
        connected = [metric for metric in hops if metric < UNREACHABLE]
        self._present += len(hops)
        self._connected += len(connected)
        self.max_hops = max(self.max_hops, *connected, 0)
        if s.search_rate == self._rates:
            return
        self._rates = s.search_rate
        now_s = seconds_of(s.tick)
        for name, rate in zip(self._cells, s.search_rate, strict=False):
            self.search_rate[name] = rate
            if rate >= 1.0 and self.search_time_s[name] is None:
                self.search_time_s[name] = now_s
        if self.search_time_s["all"] is None and all(rate >= 1.0 for rate in self.search_rate.values()):
            self.search_time_s["all"] = now_s

    @property
    def connected_fraction(self) -> float | None:
        """Robot-ticks with a finite route to the MS, over robot-ticks of living robots."""
        return round(self._connected / self._present, 6) if self._present else None
