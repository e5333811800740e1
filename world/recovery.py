"""Verdicts on faults: which robots each cut off from the MS, when they noticed, and when they had a route again.

Orphans of a fault are the living robots whose path to the MS, by the NMS pointers at that moment, went through what
failed. An orphan *notices* when its hop count becomes infinite or its NMS changes. It has a route *again* when its
hop count is finite and the pointers lead over nodes that are present, and over no jammed link, to an MS that speaks.
`loss` has no place, so its orphans are the robots that lose their route while it lasts.
An orphan's scan reports from the fault until its new route are the ones that the fault held up.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from world.config import Fault
from world.faults import describe, jam_of
from world.feed import Event, Snapshot
from world.messages import Jam, Status
from world.routes import chain_to_station
from world.terms import NOBODY, STATION, UNREACHABLE, Mode, seconds_of, tick_of

__all__ = ["Recoveries"]


@dataclass(slots=True)
class _Orphan:
    nms: int
    """At the fault."""
    incarnation: int = 0
    made_before: int = 0
    """Scan reports that it had made when it was cut off."""
    made: int = 0
    """Those that it has made by now, or had made when it was settled."""
    discarded_before: int = 0
    discarded: int = 0
    detected_tick: int | None = None
    recovered_tick: int | None = None
    departed: bool = False
    ticks_without_path: int = 0

    @property
    def settled(self) -> bool:
        return self.departed or self.recovered_tick is not None


@dataclass(slots=True)
class _Watch:
    fault: Fault
    node: int
    tick: int
    jam: Jam | None
    until_tick: int
    """A jam cuts links, and a loss makes orphans, before this tick."""
    orphans: dict[int, _Orphan] = field(default_factory=dict)

    def open(self, tick: int) -> bool:
        return (self.fault.verb == "loss" and tick < self.until_tick) or any(
            not orphan.settled for orphan in self.orphans.values()
        )


class Recoveries:
    """Watches the orphans of every fault of a run."""

    def __init__(self, station_m: tuple[float, float]) -> None:
        """`station_m`: where the MS stands."""
        self._station_m = station_m
        self._watches: list[_Watch] = []
        self._open: list[_Watch] = []

    def begin(
        self, fault: Fault, node: int, tick: int, before: Snapshot, reports: Sequence[tuple[int, Status]] = ()
    ) -> None:
        """A fault acts from `tick` on.

        Args:
            fault: what acts.
            node: on whom; NOBODY for jam and loss.
            tick: since when.
            before: the last snapshot without it.
            reports: incarnation and status of every robot, ascending by id.
        """
        until = tick + tick_of(fault.for_s or 0.0)
        jam = jam_of(fault.target) if fault.verb == "jam" else None
        watch = _Watch(fault, node, tick, jam, until)
        for robot in before.nodes.tolist():
            chain = chain_to_station(robot, before)
            cut = node in chain[1:] if jam is None else _jammed(chain, jam, before, self._station_m)
            if cut and before.hops[robot - 1] != UNREACHABLE:
                watch.orphans[robot] = _orphan(int(before.nms[robot - 1]), robot, reports)
        self._watches.append(watch)
        self._open.append(watch)

    @property
    def watching(self) -> bool:
        """Whether a verdict is still open."""
        return bool(self._open)

    def replace(self, old: Fault, new: Fault) -> None:
        """Note how an unscheduled departure ended: its `kill` became a `restart` or a `pause`."""
        for watch in self._watches:
            if watch.fault == old:
                watch.fault = new

    def update(
        self,
        before: Snapshot,
        snapshot: Snapshot,
        *,
        station_speaks: bool,
        reports: Sequence[tuple[int, Status]] = (),
    ) -> tuple[Event, ...]:
        """Follow all open watches through a tick; returns an event for each verdict that is final now.

        Args:
            before: the snapshot of the tick before.
            snapshot: of this tick.
            station_speaks: the MS takes part, and does not keep silent after a restart.
            reports: as for `begin`.
        """
        if not self._open:
            return ()
        tick = snapshot.tick
        for watch in self._open:
            if watch.fault.verb == "loss" and tick < watch.until_tick:
                self._add_losers(watch, before, snapshot, reports)
            for robot, orphan in watch.orphans.items():
                if not orphan.settled and tick >= watch.tick:
                    self._follow(watch, robot, orphan, snapshot, station_speaks)
                    if reports:
                        status = reports[robot - 1][1]
                        orphan.made = max(orphan.made, status.reports_made)
                        orphan.discarded = max(orphan.discarded, status.reports_discarded)
        closed = [watch for watch in self._open if tick >= watch.tick and not watch.open(tick + 1)]
        self._open = [watch for watch in self._open if watch not in closed]
        return tuple(_announcement(watch, tick) for watch in closed)

    @staticmethod
    def _add_losers(watch: _Watch, before: Snapshot, snapshot: Snapshot, reports: Sequence[tuple[int, Status]]) -> None:
        for robot in snapshot.nodes.tolist():
            i = robot - 1
            lost = before.hops[i] != UNREACHABLE and snapshot.hops[i] == UNREACHABLE and snapshot.mode[i] != Mode.AWAY
            if lost and snapshot.present[i] and robot not in watch.orphans:
                watch.orphans[robot] = orphan = _orphan(int(before.nms[i]), robot, reports)
                orphan.detected_tick = snapshot.tick

    def _follow(self, watch: _Watch, robot: int, orphan: _Orphan, snapshot: Snapshot, station_speaks: bool) -> None:
        i, tick = robot - 1, snapshot.tick
        if not snapshot.present[i]:
            orphan.departed = True
            return
        finite = snapshot.hops[i] != UNREACHABLE
        if orphan.detected_tick is None and not (finite and snapshot.nms[i] == orphan.nms):
            orphan.detected_tick = tick
        chain = chain_to_station(robot, snapshot) if finite and station_speaks else []
        jam = watch.jam if tick < watch.until_tick else None
        if chain and not (jam is not None and _jammed(chain, jam, snapshot, self._station_m)):
            orphan.recovered_tick = tick
        else:
            orphan.ticks_without_path += 1

    def verdicts(self) -> list[dict[str, Any]]:
        """One entry per fault, in order; `at_s` is simulated time, `detected_s` and `recovered_s` count from there.

        `recovered_s` is that of the last orphan, null unless all who lived on recovered.
        """
        return [_verdict(watch) for watch in self._watches]


def _orphan(nms: int, robot: int, reports: Sequence[tuple[int, Status]]) -> _Orphan:
    incarnation, status = reports[robot - 1] if reports else (0, Status())
    made, discarded = status.reports_made, status.reports_discarded
    return _Orphan(nms, incarnation, made, made, discarded, discarded)


def _announcement(watch: _Watch, tick: int) -> Event:
    verdict = _verdict(watch)
    names = ", ".join(map(str, verdict["orphaned"]))
    if not watch.orphans:
        words = "nobody was cut off"
    elif verdict["recovered"] is True:
        words = f"cut off {names}; the last has a route again after {verdict['recovered_s']:g} s"
    else:
        words = f"cut off {names}; none of them lived to have a route again"
    return Event(tick, "recovery", watch.node, f"{describe(watch.fault)}: {words}", verdict)


def _verdict(watch: _Watch) -> dict[str, Any]:
    orphans = watch.orphans
    living = [orphan for orphan in orphans.values() if not orphan.departed]
    back = [orphan.recovered_tick for orphan in living if orphan.recovered_tick is not None]
    recovered: bool | str = "not affected"
    if orphans:
        recovered = bool(living) and len(back) == len(living)
    noticed = [orphan.detected_tick for orphan in orphans.values() if orphan.detected_tick is not None]
    return {
        "robot": None if watch.node == NOBODY else watch.node,
        "at_s": watch.fault.at_s,
        "kind": watch.fault.verb,
        "target": watch.fault.target,
        "fault": describe(watch.fault),
        "orphaned": list(orphans),
        "detected_s": _since(watch, min(noticed, default=None)),
        "recovered_s": _since(watch, max(back)) if recovered is True else None,
        "recovered": recovered,
        "robot_seconds_without_path": seconds_of(sum(o.ticks_without_path for o in orphans.values())),
        "orphans": [
            {
                "robot": robot,
                "detected_s": _since(watch, orphan.detected_tick),
                "recovered_s": _since(watch, orphan.recovered_tick),
                "departed": orphan.departed,
                "incarnation": orphan.incarnation,
                "reports_before": orphan.made_before,
                "reports_made": orphan.made - orphan.made_before,
                "reports_discarded": orphan.discarded - orphan.discarded_before,
            }
            for robot, orphan in orphans.items()
        ],
    }


def _since(watch: _Watch, tick: int | None) -> float | None:
    return None if tick is None else seconds_of(tick - watch.tick)


def _jammed(chain: list[int], jam: Jam, snapshot: Snapshot, station_m: tuple[float, float]) -> bool:
    """Whether a jam breaks a chain: it has the pair as neighbors, or a node, the MS too, in the region."""
    if jam.pair is not None:
        return any({a, b} == set(jam.pair) for a, b in itertools.pairwise(chain))
    if jam.region_m is None:
        return False
    x0, y0, x1, y1 = jam.region_m
    places = (station_m if node == STATION else snapshot.xy_m[node - 1] for node in chain)
    return any(x0 <= x <= x1 and y0 <= y <= y1 for x, y in places)
