"""The roster: presence, returns and incarnations of every node, and the log of faults that acted on them.

A node is present, or away. Away by schedule it has a tick at which it comes back (a restart needs its new process
by then, a pause does not); away for any other reason it comes back when a process shows up, one tick after it left at
the earliest, since within a tick nobody can both leave and join.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from bus.nodes import target_name
from world.config import Fault, Verb
from world.feed import Signal
from world.terms import STATION, seconds_of, tick_of

__all__ = ["Rewritten", "Roster"]


@dataclass(frozen=True, slots=True)
class Rewritten:
    """A departure in the log, before and after the node's return."""

    was: Fault
    now: Fault


@dataclass(slots=True)
class _Member:
    present: bool = False
    first: bool = False
    """It joins in this tick."""
    back_tick: int | None = 0
    """Its scheduled return. At tick 0 all nodes come, each with a new process."""
    needs_process: bool = True
    process: bool = False
    """A process is there, though perhaps stopped."""
    waiting: bool = False
    """The process is ready to join."""
    fresh: bool = False
    """The waiting process is a new incarnation."""
    processes: int = 0
    gone_tick: int = -1
    entry: int | None = None
    """Index of its departure in the log, while that stands as `kill`."""


class Roster:
    """Presence of nodes 0 .. `nodes` - 1 and the faults that acted, in the form that a scenario accepts."""

    def __init__(self, nodes: int) -> None:
        self._members = [_Member() for _ in range(nodes)]
        self.faults: list[Fault] = []
        """Faults that acted, in order. An unscheduled departure stands as `kill` until the node is back."""
        self.unscheduled = 0

    def present(self, node: int) -> bool:
        return self._members[node].present

    def paused(self, node: int) -> bool:
        """Whether it is away by schedule with its process stopped."""
        member = self._members[node]
        return not member.present and member.back_tick is not None and not member.needs_process

    def nodes(self) -> list[int]:
        return [node for node, member in enumerate(self._members) if member.present]

    def first(self, node: int) -> bool:
        return self._members[node].first

    def incarnation(self, node: int) -> int:
        return max(self._members[node].processes - 1, 0)

    def awaited(self, tick: int) -> frozenset[int]:
        """Nodes whose scheduled return is due but whose process has not arrived."""
        return frozenset(
            node
            for node, m in enumerate(self._members)
            if m.back_tick is not None and m.back_tick <= tick and m.needs_process and not m.waiting
        )

    def deserted(self, tick: int) -> bool:
        """Whether no robot takes part any more at `tick`, none is ready to join, and none is due back."""
        robots = self._members[STATION + 1 :]
        return bool(robots) and not any(
            m.present or m.waiting or m.back_tick is not None or m.gone_tick > tick for m in robots
        )

    def arrive(self, node: int, *, new: bool) -> None:
        """A process is ready to join (new), or the one that was there answers again.

        Raises:
            ValueError: a second living process of a node.
        """
        member = self._members[node]
        if new:
            if member.present or member.waiting:
                raise ValueError(f"node {node} has a living process already")
            member.processes += 1
            member.process = member.waiting = member.fresh = True
        elif member.process and not member.present and member.back_tick is None:
            member.waiting = True

    def depart(self, node: int, tick: int, *, process: bool) -> Fault | None:
        """Note an unscheduled departure from `tick` on; `process` says whether a process is left that may come back.

        Returns:
            The new entry of the log, or None if it was known: away already.
        """
        member = self._members[node]
        paused = member.back_tick is not None and not member.needs_process
        if member.back_tick is not None and member.back_tick <= tick and member.needs_process:
            # It would have joined at this tick. Its process counts, whether it showed itself before it went or not.
            member.processes += not member.waiting
        elif not member.present and not (paused and not process):
            if not process:
                member.processes -= member.fresh  # it never took part
                member.process = member.waiting = member.fresh = False
            return None
        self._leave(member, tick, back_tick=None, process=process)
        member.entry = len(self.faults)
        self.unscheduled += 1
        self.faults.append(Fault("kill", at_s=seconds_of(tick), target=target_name(node)))
        return self.faults[-1]

    def act(self, fault: Fault, node: int, tick: int) -> tuple[Signal, ...]:
        """Carry out a scheduled kill, restart or pause on a node now.

        Returns:
            The signals that its process gets; empty if the fault can do nothing to it.
        """
        member = self._members[node]
        back = None if fault.for_s is None else tick + tick_of(fault.for_s)
        verbs: tuple[str, ...] = ()
        if fault.verb == "kill" and (member.present or member.process):
            verbs = ("kill",)
        elif fault.verb == "restart" and not (member.back_tick is not None and member.needs_process):
            verbs = ("kill", "spawn") if member.process else ("spawn",)
        elif fault.verb == "pause" and member.present:
            verbs = ("stop",)
        if not verbs:
            return ()
        self._leave(member, tick, back_tick=back, process=fault.verb == "pause")
        member.needs_process = fault.verb == "restart"
        member.entry = len(self.faults) if fault.verb == "kill" else None
        self.faults.append(dataclasses.replace(fault, at_s=seconds_of(tick), target=target_name(node)))
        return tuple(Signal(tick, node, verb) for verb in verbs)

    def admit(self, tick: int) -> tuple[list[tuple[int, Rewritten | None]], list[Signal]]:
        """Admit all nodes that come back at `tick`.

        Returns:
            (node, its entry of the log if that changed) for each, and the signals that thaw paused ones.
        """
        joined: list[tuple[int, Rewritten | None]] = []
        signals = []
        for node, member in enumerate(self._members):
            member.first = False
            if member.present:
                continue
            scheduled = member.back_tick is not None
            if scheduled:
                ready = member.back_tick <= tick and (member.waiting or not member.needs_process)  # type: ignore[operator]
            else:
                ready = member.waiting and tick > member.gone_tick
            if not ready:
                continue
            if scheduled and not member.needs_process:
                signals.append(Signal(tick, node, "cont"))
            joined.append((node, self._returned(member, tick)))
            member.present = member.first = True
            member.waiting = member.fresh = False
            member.back_tick = member.entry = None
        return joined, signals

    def _returned(self, member: _Member, tick: int) -> Rewritten | None:
        if member.entry is None:
            return None
        gone = self.faults[member.entry]
        for_s = seconds_of(tick - tick_of(gone.at_s))
        verb: Verb = "restart" if member.fresh else "pause"
        self.faults[member.entry] = dataclasses.replace(gone, verb=verb, for_s=for_s)
        return Rewritten(gone, self.faults[member.entry])

    @staticmethod
    def _leave(member: _Member, tick: int, *, back_tick: int | None, process: bool) -> None:
        member.present = member.waiting = member.fresh = False
        member.process = process
        member.back_tick = back_tick
        member.gone_tick = tick
