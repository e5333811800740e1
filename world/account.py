"""The account of a tick: its snapshot, its events, and what it adds to the counts of the summary.

The core closes a tick as soon as all robots have moved. The account is settled later, when it is asked for or when the
next tick depends on it, so that no process waits for it.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from world.config import Fault, WorldConfig
from world.connectivity import Connectivity
from world.events import changes
from world.faults import fault_form
from world.feed import Event, Snapshot
from world.messages import Motion, Report, Status
from world.recovery import Recoveries
from world.roster import Rewritten, Roster
from world.scan_times import ScanTimes
from world.terms import STATION

__all__ = ["Account", "Told"]


@dataclass(slots=True, init=False)
class Told:
    """The account of one tick."""

    snapshot: Snapshot
    events: tuple[Event, ...]

    def __init__(self, snapshot: Snapshot, events: tuple[Event, ...]) -> None:
        self.snapshot = snapshot
        self.events = events


@dataclass(slots=True, init=False)
class _Closed:
    """What a closed tick leaves for its account, besides the statuses of the robots."""

    tick: int
    present: list[bool]
    xy_m: NDArray[np.float64]
    report: Report | None
    events: tuple[Event, ...]

    def __init__(
        self,
        tick: int,
        present: list[bool],
        xy_m: NDArray[np.float64],
        report: Report | None,
        events: tuple[Event, ...],
    ) -> None:
        self.tick = tick
        self.present = present
        self.xy_m = xy_m
        self.report = report
        self.events = events


class Account:
    """Keeps the accounts of all ticks of a run."""

    snapshot: Snapshot
    """Of the last settled tick."""

    def __init__(self, config: WorldConfig, roster: Roster) -> None:
        self._roster = roster
        self._cell_names = config.cell_names
        self._victims = len(config.victims_m)
        self._nodes = np.arange(1, config.robots + 1, dtype=np.int16)
        self._recoveries = Recoveries(config.station_m)
        # What robots and station said last.
        self._statuses = [Status()] * config.robots
        self._reported: tuple[tuple[float, ...], int, tuple[int, ...]] = ((), 0, ())
        """Search rates, reports merged, victims found."""
        # The tick under way, the one that is closed but not settled, and the last settled one.
        self._events: list[Event] = []
        self._closed: _Closed | None = None
        starts_m = np.array(config.starts_m, np.float64).reshape(-1, 2)
        self.snapshot = self._photograph(_Closed(0, self._present(), starts_m, None, ()))
        self._told = Told(self.snapshot, ())
        # Counts over the run.
        self._made_before: dict[str, int] = {}
        """Scan reports that earlier incarnations made, by "robot/incarnation"."""
        self._discarded_before = [0] * config.robots
        self._connectivity = Connectivity()
        self._scan_times = ScanTimes(config.robots)
        self._walked_m = np.zeros(config.robots)

    def note(self, tick: int, node: int, text: str, data: dict[str, Any]) -> None:
        """Add a fault event to the tick under way."""
        self._events.append(Event(tick, "fault", node, text, data))

    def faulted(self, fault: Fault, node: int, tick: int) -> None:
        """Follow whom a fault cuts off that acts on a node (NOBODY for jam and loss) from `tick` on."""
        self._recoveries.begin(fault, node, tick, self.snapshot, self._reports())

    def rewritten(self, entry: Rewritten) -> None:
        """Note how an unscheduled departure ended."""
        self._recoveries.replace(entry.was, entry.now)

    def renew(self, node: int) -> None:
        """Begin a new incarnation of a node: its predecessor's last status holds no longer, but its reports count."""
        if node == STATION:
            return
        past, incarnation = self._statuses[node - 1], self._roster.incarnation(node)
        if past.reports_made:
            self._made_before[f"{node}/{incarnation - 1}"] = past.reports_made
        self._scan_times.renew(node - 1, f"{node}/{incarnation - 1}")
        self._discarded_before[node - 1] += past.reports_discarded
        self._statuses[node - 1] = Status()

    def close(self, tick: int, motions: Mapping[int, Motion], xy_m: NDArray[np.float64], report: Report | None) -> None:
        """Close a tick.

        Args:
            tick: which.
            motions: of every robot whose motion counts.
            xy_m: (robots, 2) true positions at the start of the tick.
            report: the station's, or None while it is away.
        """
        self.settle()
        for node, motion in motions.items():
            self._statuses[node - 1] = motion.status
            self._scan_times.note(node - 1, motion.status)
        self._closed = _Closed(tick, self._present(), xy_m, report, tuple(self._events))
        self._events = []

    def settle(self) -> None:
        """Settle the account of the closed tick, unless that is done: before anything that it depends on changes."""
        closed, self._closed = self._closed, None
        if closed is None:
            return
        before, self.snapshot = self.snapshot, self._photograph(closed)
        self._connectivity.add(self.snapshot)
        self._walked_m += np.hypot(*(self.snapshot.xy_m - before.xy_m).T)
        verdicts: tuple[Event, ...] = ()
        if self._recoveries.watching:
            speaks = closed.report is not None and not closed.report.silent
            verdicts = self._recoveries.update(before, self.snapshot, station_speaks=speaks, reports=self._reports())
        seen = changes(before, self.snapshot, self._cell_names)
        self._told = Told(self.snapshot, (*closed.events, *seen, *verdicts))

    @property
    def watching(self) -> bool:
        """Whether a fault is followed; then a tick must be settled before the next begins."""
        return self._recoveries.watching

    def tell(self) -> Told:
        """The account of the tick that was closed last."""
        self.settle()
        return self._told

    def final(self) -> dict[str, Any]:
        """What the summary takes from here; `faults` are those that acted, in the form that a scenario accepts."""
        self.settle()
        statuses = self._statuses
        made = self._made_before | {
            f"{node}/{self._roster.incarnation(node)}": s.reports_made
            for node, s in enumerate(statuses, 1)
            if s.reports_made
        }
        present = {node: s for node, s in enumerate(statuses, 1) if self._roster.present(node)}
        return {
            "connected_fraction": self._connectivity.fraction,
            "max_hops": self._connectivity.max_hops,
            "longest_absence_s": self._connectivity.longest_absence_s,
            "planned_absences": self._connectivity.planned_absences,
            "walked_m": round(float(self._walked_m.sum()), 1),
            "scan_reports": {
                "made": sum(made.values()),
                "buffered": sum(s.reports_buffered for s in present.values()),
                "discarded": sum(self._discarded_before) + sum(s.reports_discarded for s in statuses),
            },
            "made": made,
            "scan_ticks": self._scan_times.final(
                [f"{node}/{self._roster.incarnation(node)}" for node in range(1, len(statuses) + 1)]
            ),
            "acknowledged": {
                str(node): [self._roster.incarnation(node), s.reports_made - s.reports_buffered]
                for node, s in present.items()
            },
            # One whose last tick counted is noted before one whose last tick, the same, did not: time goes before that.
            "faults": [fault_form(fault) for fault in sorted(self._roster.faults, key=lambda fault: fault.at_s)],
            "wall_clock_faults": self._roster.unscheduled,
            "recoveries": sorted(self._recoveries.verdicts(), key=lambda verdict: verdict["at_s"]),
        }

    def _reports(self) -> list[tuple[int, Status]]:
        """Incarnation and last status of every robot."""
        return [(self._roster.incarnation(node), status) for node, status in enumerate(self._statuses, 1)]

    def _present(self) -> list[bool]:
        return [self._roster.present(node) for node in range(1, len(self._statuses) + 1)]

    def _photograph(self, closed: _Closed) -> Snapshot:
        """The snapshot of a tick. A robot that was away has no route in it, and its last status otherwise."""
        statuses, present, report = self._statuses, closed.present, closed.report
        routed = [status if here else _AWAY for status, here in zip(statuses, present, strict=True)]
        targets_m: list[float] = []
        for status in statuses:
            targets_m += (status.target_x_m, status.target_y_m)
        if report is not None:
            # A robot may have told the MS of victims that nobody placed.
            found = tuple(victim for victim in report.victims_found if victim < self._victims)
            self._reported = (report.search_rate, report.merged, found)
        return Snapshot(
            closed.tick,
            self._nodes,
            _bytes(present),
            closed.xy_m,
            _bytes([status.cls for status in statuses]),
            _bytes([status.mode for status in statuses]),
            _bytes([status.hops for status in routed]),
            np.frombuffer(array("h", [status.nms for status in routed]), np.int16),
            np.frombuffer(array("h", [status.msr for status in routed]), np.int16),
            np.frombuffer(array("d", targets_m), np.float64).reshape(-1, 2),
            sum(s.reports_buffered for s in routed),
            *self._reported,
        )


_AWAY: Final = Status()


def _bytes(values: Sequence[int]) -> NDArray[np.uint8]:
    """A column of a few small numbers: ten times as fast as `np.array`."""
    return np.frombuffer(bytes(values), np.uint8)
