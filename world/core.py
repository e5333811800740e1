"""Ground truth of a run, tick by tick, and the judge of who takes part, which faults act, and when it ends.

The caller's duty: at every tick wait until `awaited()` is empty, call `begin()`, hand out what it returns, collect the
motions of the roster and the station's report, and call `end()`. `arrive`, `depart`, `inject`, `interrupt` and `fail`
may come at any time in between. `tell()` says what a tick came to, and may wait until the next one has begun. Whatever
is random comes from a generator of the seed, one per purpose.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from world.config import Fault, WorldConfig
from world.events import changes
from world.faults import check_fault, describe, fault_form, jam_of, resolve, tick_of
from world.geometry import pad
from world.messages import (
    NOBODY,
    STATION,
    TICK_S,
    UNREACHABLE,
    Event,
    Jam,
    Motion,
    Positions,
    Report,
    Sense,
    Signal,
    Snapshot,
    Status,
    Stop,
)
from world.motion import move
from world.recovery import Recoveries
from world.roster import Roster
from world.senses import Purpose, Senses, seeded

__all__ = ["Begin", "Told", "World"]


@dataclass(slots=True, init=False)
class Begin:
    """What the world hands out at the start of a tick."""

    tick: int
    senses: dict[int, Sense]
    """One per node of the roster, ascending."""
    positions: Positions
    signals: tuple[Signal, ...]
    """What the supervisor does to processes now."""
    unheard: dict[int, Sense]
    """Of each node that is paused now: it still takes this step, and nobody waits for it or hears of it. A process that
    is stopped at any moment does the same, so a freeze by hand can be replayed."""

    def __init__(
        self,
        tick: int,
        senses: dict[int, Sense],
        positions: Positions,
        signals: tuple[Signal, ...],
        unheard: dict[int, Sense] | None = None,
    ) -> None:
        self.tick = tick
        self.senses = senses
        self.positions = positions
        self.signals = signals
        self.unheard = unheard or {}


@dataclass(slots=True, init=False)
class Told:
    """What a tick came to."""

    snapshot: Snapshot
    events: tuple[Event, ...]

    def __init__(self, snapshot: Snapshot, events: tuple[Event, ...]) -> None:
        self.snapshot = snapshot
        self.events = events


class _Ended:
    """What the account of a tick that has ended is made of, besides the last statuses."""

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


class World:
    """The true state of one run."""

    tick: int
    """The tick that the next `begin()` starts."""

    def __init__(self, config: WorldConfig) -> None:
        self.tick = 0
        self._config = config
        self._walls, self._geometry = pad(config.occupied, config.geometry)
        self._senses = Senses(config)
        self._choice = seeded(config.seed, Purpose.CHOICE)
        self._nodes = np.arange(1, config.robots + 1, dtype=np.int16)
        self._xy = np.vstack((np.array(config.station_m, np.float64), np.asarray(config.starts_m, np.float64)))
        self._roster = Roster(config.robots + 1)
        self._taking_part: list[int] = []
        """The roster of the tick that has begun."""
        self._ticking = False
        self._statuses = [Status()] * config.robots
        self._made_before = [0] * config.robots
        """Scan reports that earlier incarnations made."""
        self._discarded_before = [0] * config.robots
        self._reported: tuple[tuple[float, ...], int, tuple[int, ...]] = ((), 0, ())
        """The station's last word: search rates, reports merged, victims found."""
        self._snapshot = self._photograph(_Ended(0, self._present(), self._xy[1:].copy(), None, ()))
        self._ended: _Ended | None = None
        """The last tick, while it is not accounted for."""
        self._told = Told(self._snapshot, ())
        self._schedule: dict[int, list[Fault]] = {}
        for fault in config.faults:
            self._schedule.setdefault(tick_of(fault.at_s), []).append(fault)
        self._by_hand: list[Fault] = []
        self._jams: list[tuple[int, Jam]] = []
        self._losses: list[tuple[int, float]] = []
        self._recoveries = Recoveries(config.station_m)
        self._events: list[Event] = []
        self._interrupted = False
        self._status = "failed"
        self._why = ""
        self._robot_ticks = self._connected_ticks = self._max_hops = 0

    # Who takes part

    def awaited(self) -> frozenset[int]:
        """Nodes (0 = station) whose process must be there before `begin()`: at tick 0 all, later those due back now."""
        return self._roster.awaited(self.tick)

    def arrive(self, node: int, *, new: bool) -> None:
        """A process is there (new: another incarnation) or answers again; it takes part from the next tick on.

        Raises:
            ValueError: the node has a living process already.
        """
        self._account()
        self._roster.arrive(node, new=new)
        if new and node != STATION:
            past = self._statuses[node - 1]
            self._made_before[node - 1] += past.reports_made
            self._discarded_before[node - 1] += past.reports_discarded
            self._statuses[node - 1] = Status()

    def depart(self, node: int, cause: str, *, counted: bool) -> None:
        """A node left that nobody sent away: it "died", is "unresponsive", or ended by an "exception".

        Args:
            node: who.
            cause: why.
            counted: its frames and motion of the tick that has begun still counted.
        """
        self._account()
        since = self.tick + (1 if counted and self._ticking else 0)
        entry = self._roster.depart(node, since, process=cause == "unresponsive")
        if entry is None:
            return
        took = "its last tick counted" if counted else "its last tick did not count"
        self._log(node, f"{_name(node)}: {cause}; {took}", fault_form(entry) | {"cause": cause})
        self._recoveries.begin(entry, node, since, self._snapshot, self._reports())

    def inject(self, fault: Fault) -> None:
        """A fault by hand: it acts at the next `begin()`, whatever its own time says.

        Raises:
            ValueError: it names no robot of this run, or is wrong in itself; one line.
        """
        check_fault(fault, self._config.robots)
        self._by_hand.append(fault)

    # A tick

    def begin(self) -> Begin:
        """Start a tick: returns, then faults, then what everybody senses.

        Raises:
            RuntimeError: the tick before has not ended, or somebody is awaited.
        """
        awaited = self.awaited()
        if self._ticking or awaited:
            raise RuntimeError(f"tick {self.tick} cannot begin: begun {self._ticking}, awaited {sorted(awaited)}")
        tick = self.tick
        if self._by_hand or tick in self._schedule:
            self._account()
        signals = self._admit(tick)
        before = self._roster.nodes()
        signals += self._act(tick)
        self._ticking = True
        self._taking_part = self._roster.nodes()
        present = np.array(self._taking_part, np.int16)
        paused = [node for node in before if self._roster.paused(node)]
        return Begin(
            tick,
            self._senses.at(tick, self._taking_part, self._xy, self._roster),
            Positions(tick, present, self._xy[present], self._jams_of(tick), self._loss_of(tick)),
            tuple(signals),
            self._senses.at(tick, paused, self._xy, self._roster) if paused else {},
        )

    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None:
        """End the tick: move everybody and judge; returns how the run ends if it does.

        Args:
            motions: of every robot that took part and has not departed since; of those that departed, if it counted.
            report: the station's, or None while it is away.

        Raises:
            RuntimeError: no tick has begun, or the motion of a robot that takes part is missing.
        """
        missing = [n for n in self._taking_part if n != STATION and n not in motions and self._roster.present(n)]
        if not self._ticking or missing:
            raise RuntimeError(f"tick {self.tick} cannot end: begun {self._ticking}, motions missing of {missing}")
        self._account()
        for node in self._taking_part:
            if node in motions:
                self._statuses[node - 1] = motions[node].status
        self._ended = _Ended(self.tick, self._present(), self._xy[1:].copy(), report, tuple(self._events))
        self._events = []
        self._move(motions)
        stop = self._judge(report)
        self._ticking = False
        self.tick += 1
        if self._recoveries.watching:
            self._account()
        return stop

    def tell(self) -> Told:
        """What the tick that ended last came to; may be asked when the next has begun, so that nobody waits for it."""
        self._account()
        return self._told

    def interrupt(self) -> None:
        """Let the run end with this or the next tick."""
        self._interrupted = True

    def fail(self, why: str) -> Stop:
        """End the run as failed, now."""
        self._status, self._why = "failed", why
        return Stop(self.tick, "failed")

    def final(self) -> dict[str, Any]:
        """The world's part of the summary; `faults` is what acted, in the form that a scenario accepts."""
        self._account()
        statuses = self._statuses
        present = [s for node, s in enumerate(statuses, 1) if self._roster.present(node)]
        summary: dict[str, Any] = {
            "status": self._status,
            "ticks": self.tick,
            "connected_fraction": self._connected_ticks / self._robot_ticks if self._robot_ticks else 0.0,
            "max_hops": self._max_hops,
            "scan_reports": {
                "made": sum(self._made_before) + sum(s.reports_made for s in statuses),
                "buffered": sum(s.reports_buffered for s in present),
                "discarded": sum(self._discarded_before) + sum(s.reports_discarded for s in statuses),
            },
            "acknowledged": {
                str(node): [self._roster.incarnation(node), s.reports_made - s.reports_buffered]
                for node, s in enumerate(statuses, 1)
                if self._roster.present(node)
            },
            "faults": [fault_form(fault) for fault in self._roster.faults],
            "wall_clock_faults": self._roster.unscheduled,
            "recoveries": self._recoveries.verdicts(),
        }
        if self._why:
            summary["why"] = self._why
        return summary

    # Faults

    def _admit(self, tick: int) -> list[Signal]:
        joined, signals = self._roster.admit(tick)
        for node, entry in joined:
            if entry is not None:
                self._recoveries.replace(entry.was, entry.now)
            if tick > 0 and entry is None:
                self._log(node, f"{_name(node)} is back", {})
            elif tick > 0 and entry is not None:
                self._log(node, f"{_name(node)} is back ({describe(entry.now)})", fault_form(entry.now))
        return signals

    def _act(self, tick: int) -> list[Signal]:
        signals: list[Signal] = []
        for fault in self._schedule.pop(tick, ()):
            signals += self._carry_out(fault, tick)
        by_hand, self._by_hand = self._by_hand, []
        for fault in by_hand:
            self._roster.unscheduled += 1
            signals += self._carry_out(fault, tick)
        return signals

    def _carry_out(self, fault: Fault, tick: int) -> tuple[Signal, ...]:
        fault = Fault(fault.verb, round(tick * TICK_S, 1), fault.target, fault.for_s, fault.probability)
        if fault.verb in ("jam", "loss"):
            until = tick + tick_of(fault.for_s or 0.0)
            if fault.verb == "jam":
                self._jams.append((until, jam_of(fault.target)))
            else:
                self._losses.append((until, fault.probability))
            self._roster.faults.append(fault)
            self._log(NOBODY, describe(fault), fault_form(fault))
            self._recoveries.begin(fault, NOBODY, tick, self._snapshot, self._reports())
            return ()
        node = resolve(fault.target, self._snapshot, self._config.station_m, self._choice)
        if node is None:
            self._log(NOBODY, f"{describe(fault)}: nobody is {fault.target}, nothing done", {})
            return ()
        signals = self._roster.act(fault, node, tick)
        if not signals:
            self._log(node, f"{describe(fault)}: {_name(node)} is away already, nothing done", {})
            return ()
        acted = self._roster.faults[-1]
        self._log(node, f"{describe(fault)} ({_name(node)})", fault_form(acted))
        self._recoveries.begin(acted, node, tick, self._snapshot, self._reports())
        return signals

    def _jams_of(self, tick: int) -> tuple[Jam, ...]:
        self._jams = [(until, jam) for until, jam in self._jams if tick < until]
        return tuple(jam for _, jam in self._jams)

    def _loss_of(self, tick: int) -> float:
        self._losses = [(until, loss) for until, loss in self._losses if tick < until]
        return 1.0 - math.prod(1.0 - loss for _, loss in self._losses) if self._losses else 0.0

    def _log(self, node: int, text: str, data: dict[str, Any]) -> None:
        self._events.append(Event(self.tick, "fault", node, text, data))

    def _reports(self) -> list[tuple[int, Status]]:
        """Incarnation and last status of every robot."""
        return [(self._roster.incarnation(node), status) for node, status in enumerate(self._statuses, 1)]

    # The end of a tick

    def _move(self, motions: Mapping[int, Motion]) -> None:
        velocities = [(0.0, 0.0)] * len(self._statuses)
        for node in self._taking_part:
            if node in motions:
                velocities[node - 1] = motions[node].vx_m_s, motions[node].vy_m_s
        self._xy[1:] = move(self._walls, self._geometry, self._xy[1:], velocities, self._config.top_speed_m_s)

    def _present(self) -> list[bool]:
        return [self._roster.present(node) for node in range(1, len(self._statuses) + 1)]

    def _account(self) -> None:
        """Work out what the last tick came to, unless that was done."""
        ended, self._ended = self._ended, None
        if ended is None:
            return
        before, self._snapshot = self._snapshot, self._photograph(ended)
        self._count()
        verdicts: tuple[Event, ...] = ()
        if self._recoveries.watching:
            speaks = ended.report is not None and not ended.report.silent
            verdicts = self._recoveries.update(before, self._snapshot, station_speaks=speaks, reports=self._reports())
        seen = changes(before, self._snapshot, self._config.cell_names)
        self._told = Told(self._snapshot, (*ended.events, *seen, *verdicts))

    def _photograph(self, ended: _Ended) -> Snapshot:
        """The snapshot of a tick; one who was away shows no route, and else his last status."""
        statuses, present, report = self._statuses, ended.present, ended.report
        routed = [status if here else _AWAY for status, here in zip(statuses, present, strict=True)]
        targets_m: list[float] = []
        for status in statuses:
            targets_m += (status.target_x_m, status.target_y_m)
        if report is not None:
            self._reported = (report.search_rate, report.merged, report.victims_found)
        return Snapshot(
            ended.tick,
            self._nodes,
            _bytes(present),
            ended.xy_m,
            _bytes([status.cls for status in statuses]),
            _bytes([status.mode for status in statuses]),
            _bytes([status.hops for status in routed]),
            np.frombuffer(array("h", [status.nms for status in routed]), np.int16),
            np.frombuffer(array("h", [status.msr for status in routed]), np.int16),
            np.frombuffer(array("d", targets_m), np.float64).reshape(-1, 2),
            sum(s.reports_buffered for s in routed),
            *self._reported,
        )

    def _count(self) -> None:
        for here, hops in zip(self._snapshot.present.tolist(), self._snapshot.hops.tolist(), strict=True):
            self._robot_ticks += here
            if here and hops != UNREACHABLE:
                self._connected_ticks += 1
                self._max_hops = max(self._max_hops, hops)

    def _judge(self, report: Report | None) -> Stop | None:
        if report is not None and report.searched:
            self._status = "searched"
        elif self._interrupted:
            self._status = "interrupted"
        elif self.tick + 1 >= tick_of(self._config.duration_s):
            self._status = "time_limit"
        else:
            return None
        return Stop(self.tick, self._status)


_AWAY = Status()


def _bytes(values: Sequence[int]) -> NDArray[np.uint8]:
    """A column of a few small numbers: ten times as fast as `np.array`."""
    return np.frombuffer(bytes(values), np.uint8)


def _name(node: int) -> str:
    return f"robot {node}" if node else "station"
