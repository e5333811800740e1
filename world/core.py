"""Ground truth of a run, tick by tick, and the judge of who takes part, which faults act, and when the run ends.

The caller's duty: at every tick, wait until `awaited()` is empty, call `begin()`, hand out what it returns, collect the
motions of the roster and the station's report, and call `end()`. `arrive`, `depart`, `inject`, `interrupt` and `fail`
may be called at any time in between. `tell()` gives the account of the last tick and may be called after the next
`begin()`. Random numbers come from the streams of `world/seeds.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from bus.excerpt import shown
from bus.nodes import node_name
from world.account import Account, Told
from world.agenda import Agenda
from world.bodies import Bodies
from world.config import Fault, WorldConfig
from world.faults import NOT_OURS, check_fault, describe, fault_form, resolve
from world.feed import Signal
from world.grid.lines import pad
from world.messages import Motion, Positions, Report, Sense, Stop
from world.motion import move
from world.roster import Roster
from world.seeds import Stream, sequence
from world.senses import Senses
from world.terms import NOBODY, STATION, seconds_of, tick_of

__all__ = ["DIED", "Begin", "Core", "World"]

DIED: Final = "died"
"""Cause of the departure of a node whose process is gone. With any other cause its process is still there."""


@dataclass(slots=True, init=False)
class Begin:
    """What the world hands out at the start of a tick."""

    tick: int
    senses: dict[int, Sense]
    """One per node of the roster, ascending."""
    positions: Positions
    signals: tuple[Signal, ...]
    """What the launcher does to processes now."""
    unheard: dict[int, Sense]
    """Senses of nodes that are paused in this tick. Such a node still takes this step, but nobody waits for it or hears
    of it. A process that is stopped by hand does the same, so such a pause can be replayed."""

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


class Core(Protocol):
    """What a shell drives: `World`, or one that does nothing, to measure the shell alone."""

    tick: int

    def awaited(self) -> frozenset[int]: ...
    def arrive(self, node: int, *, new: bool) -> None: ...
    def depart(self, node: int, cause: str, *, counted: bool) -> None: ...
    def inject(self, fault: Fault) -> None: ...
    def begin(self) -> Begin: ...
    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None: ...
    def tell(self) -> Told: ...
    def interrupt(self) -> None: ...
    def fail(self, why: str) -> Stop: ...
    def final(self) -> dict[str, Any]: ...


class World:
    """The true state of one run."""

    tick: int
    """The tick that the next `begin()` starts."""

    def __init__(self, config: WorldConfig) -> None:
        self.tick = 0
        self._config = config
        # Ground truth: walls, positions (row 0 is the station), and the sensors that see both.
        self._walls, self._geometry = pad(config.occupied, config.geometry)
        self._xy = np.vstack((np.array(config.station_m, np.float64), np.asarray(config.starts_m, np.float64)))
        self._bodies = Bodies(config.body_radius_m, self._walls, self._geometry)
        self._senses = Senses(config)
        # Who takes part, in the run and in the tick that has begun.
        self._roster = Roster(config.robots + 1)
        self._taking_part: list[int] = []
        self._ticking = False
        # Which faults act, and on which node those with target `random`.
        self._agenda = Agenda(config.faults)
        self._choice = sequence(config.seed, Stream.CHOICE)
        # The account of the ticks, and how the run ends.
        self._account = Account(config, self._roster)
        self._interrupted = False
        self._status = "failed"
        self._why = ""

    # Who takes part

    def awaited(self) -> frozenset[int]:
        """Nodes whose process must be there before `begin()`: all at tick 0, later those whose return is due."""
        return self._roster.awaited(self.tick)

    def arrive(self, node: int, *, new: bool) -> None:
        """A process has come (new: another incarnation), or answers again; it takes part from the next tick on.

        Raises:
            ValueError: the node has a living process already.
        """
        self._account.settle()
        self._roster.arrive(node, new=new)
        if new:
            self._account.renew(node)

    def depart(self, node: int, cause: str, *, counted: bool) -> None:
        """A node left without a scheduled fault.

        Args:
            node: which.
            cause: DIED, or why the node was given up.
            counted: whether its frames and motion of the tick under way still counted.
        """
        self._account.settle()
        since = self.tick + (1 if counted and self._ticking else 0)
        entry = self._roster.depart(node, since, process=cause != DIED)
        if entry is None:
            return
        took = "its last tick counted" if counted else "its last tick did not count"
        self._log(node, f"{node_name(node)}: {cause}; {took}", fault_form(entry) | {"cause": cause})
        self._account.faulted(entry, node, since)

    def inject(self, fault: Fault) -> None:
        """Add a fault by hand. It acts at the next `begin()`, whatever its own time is.

        Raises:
            ValueError: the fault is wrong in itself, or names no robot of this run; one line.
        """
        check_fault(fault, self._config.robots, external=self._config.external)
        self._agenda.add(fault)

    def schedule(self, fault: Fault) -> None:
        """Add a fault to those of the scenario, as its last. It acts at its own time, which has not passed.

        Raises:
            ValueError: that time has passed, or the fault does not fit this run; one line.
        """
        check_fault(fault, self._config.robots, self._config.duration_s)
        if tick_of(fault.at_s) < self.tick:
            raise ValueError(f"{shown(describe(fault))}: the run is at {seconds_of(self.tick):g} s already")
        self._agenda.schedule(fault)

    # A tick

    def begin(self) -> Begin:
        """Start a tick: returns of nodes, then faults, then senses.

        Raises:
            RuntimeError: the last tick has not ended, or a node is awaited.
        """
        awaited = self.awaited()
        if self._ticking or awaited:
            whom = shown(sorted(awaited))
            raise RuntimeError(f"tick {self.tick} cannot begin: begun {self._ticking}, awaited {whom}")
        tick = self.tick
        if self._agenda.due(tick):
            self._account.settle()
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
            Positions(tick, present, self._xy[present], self._agenda.jams(tick), self._agenda.loss(tick)),
            tuple(signals),
            self._senses.at(tick, paused, self._xy, self._roster) if paused else {},
        )

    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None:
        """End the tick: move the robots, and judge; returns the stop if the run ends.

        Args:
            motions: of each robot that took part and has not departed since, and of those departed whose tick counted.
            report: the station's, or None while it is away.

        Raises:
            RuntimeError: no tick has begun, or the motion of a robot that takes part is missing.
        """
        missing = [n for n in self._taking_part if n != STATION and n not in motions and self._roster.present(n)]
        if not self._ticking or missing:
            raise RuntimeError(f"tick {self.tick} cannot end: begun {self._ticking}, motions missing of {missing}")
        counted = {node: motions[node] for node in self._taking_part if node in motions}
        self._account.close(self.tick, counted, self._xy[1:].copy(), report)
        self._move(counted)
        stop = self._judge(report, moved=bool(counted))
        self._ticking = False
        self.tick += 1
        if self._account.watching:
            self._account.settle()
        return stop

    def tell(self) -> Told:
        """The account of the last tick; asked for after the next has begun, it delays nobody."""
        return self._account.tell()

    def interrupt(self) -> None:
        """End the run with the tick under way, or with the next."""
        self._interrupted = True

    def fail(self, why: str) -> Stop:
        """End the run as failed, now."""
        self._status, self._why = "failed", why
        return Stop(self.tick, "failed")

    def final(self) -> dict[str, Any]:
        """The world's part of the summary."""
        summary: dict[str, Any] = {"status": self._status, "ticks": self.tick} | self._account.final()
        summary["blocked_moves"] = dict(self._bodies.blocked_moves)
        if self._why:
            summary["why"] = self._why
        return summary

    # Faults

    def _admit(self, tick: int) -> list[Signal]:
        joined, signals = self._roster.admit(tick)
        for node, entry in joined:
            if entry is not None:
                self._account.rewritten(entry)
            if tick > 0 and entry is None:
                self._log(node, f"{node_name(node)} is back", {})
            elif tick > 0 and entry is not None:
                self._log(node, f"{node_name(node)} is back ({describe(entry.now)})", fault_form(entry.now))
        return signals

    def _act(self, tick: int) -> list[Signal]:
        signals: list[Signal] = []
        for fault, by_hand in self._agenda.take(tick):
            self._roster.unscheduled += by_hand
            signals += self._carry_out(fault, tick)
        return signals

    def _carry_out(self, fault: Fault, tick: int) -> tuple[Signal, ...]:
        fault = Fault(fault.verb, seconds_of(tick), fault.target, fault.for_s, fault.probability)
        asked = describe(fault)
        if fault.verb in ("jam", "loss"):
            self._agenda.disturb(fault, tick)
            self._roster.faults.append(fault)
            self._log(NOBODY, asked, fault_form(fault) | {"asked": asked})
            self._account.faulted(fault, NOBODY, tick)
            return ()
        node = resolve(fault.target, self._account.snapshot, self._config.station_m, self._choice)
        if node is None:
            self._log(NOBODY, f"{asked}: nobody is {fault.target}, nothing done", {})
            return ()
        if node in self._config.external:
            self._log(node, f"{asked}: {node_name(node)}: {NOT_OURS}", {})
            return ()
        signals = self._roster.act(fault, node, tick)
        if not signals:
            self._log(node, f"{asked}: {node_name(node)} is away already, nothing done", {})
            return ()
        acted = self._roster.faults[-1]
        self._log(node, f"{asked} ({node_name(node)})", fault_form(acted) | {"asked": asked})
        self._account.faulted(acted, node, tick)
        return signals

    def _log(self, node: int, text: str, data: dict[str, Any]) -> None:
        self._account.note(self.tick, node, text, data)

    # The end of a tick

    def _move(self, motions: Mapping[int, Motion]) -> None:
        velocities = [(0.0, 0.0)] * (len(self._xy) - 1)
        for node, motion in motions.items():
            velocities[node - 1] = motion.vx_m_s, motion.vy_m_s
        wanted = move(self._walls, self._geometry, self._xy[1:], velocities, self._config.top_speed_m_s)
        live = [self._roster.present(node) for node in range(1, len(self._xy))]
        self._xy[1:] = self._bodies.stop(self._xy[1:], wanted, live)

    def _judge(self, report: Report | None, *, moved: bool) -> Stop | None:
        if report is not None and report.searched:
            self._status = "searched"
        elif report is not None and report.exhausted:
            self._status, self._why = "exhausted", "the map has no frontier to which a path leads"
        elif self._interrupted:
            self._status = "interrupted"
        elif self.tick + 1 >= tick_of(self._config.duration_s):
            self._status = "time_limit"
        elif not moved and self._roster.deserted(self.tick) and not self._agenda.revives():
            self._status, self._why = "no_robots", "no robot is left, and none is due back"
        else:
            return None
        return Stop(self.tick, self._status)
