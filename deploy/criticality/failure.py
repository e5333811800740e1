"""What is done in a branch: the mission as it is, and the mission with one failure more, watched for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from deploy.branching.trunk import Branch, Past
from world.feed import Snapshot
from world.routes import chain_to_station
from world.terms import UNREACHABLE, Mode, seconds_of, tick_of

__all__ = ["STEADY_S", "Failure", "Verb", "fail", "lacking", "run_mission"]

Verb = Literal["kill", "pause", "restart"]

STEADY_S: Final = 10.0
"""A branch ends once everybody has had a path for this long."""


@dataclass(frozen=True)
class Failure:
    """What happens to a robot, and for how long the others are watched."""

    verb: Verb
    for_s: float | None
    """How long it is away; None for kill."""
    horizon_s: float
    to_end: bool
    """Whether a branch goes on to the end of its mission."""

    def fault(self, robot: int, tick: int) -> dict[str, Any]:
        """The failure of one robot, as a scenario's [[fault]] has it."""
        lasting = {} if self.for_s is None else {"for_s": self.for_s}
        return {"verb": self.verb, "target": str(robot), "at_s": seconds_of(tick), **lasting}


def lacking(snapshot: Snapshot) -> int:
    """How many robots take part and have no path to the MS along next hops, those on an announced sortie aside."""
    hops, mode = snapshot.hops.tolist(), snapshot.mode.tolist()
    return sum(
        hops[row] == UNREACHABLE or not chain_to_station(robot, snapshot)
        for row, robot in enumerate(snapshot.nodes.tolist())
        if snapshot.present[row] and mode[row] != Mode.AWAY
    )


def run_mission(past: Past, _branch: Branch, every: int) -> dict[str, Any]:
    """The mission as it is, in JSON types.

    Args:
        past: of tick 0.
        every: ticks between the moments at which robots may fail.
    """
    missing: list[int] = []
    places: dict[str, dict[str, tuple[float, float]]] = {}
    victims: dict[str, int] = {}
    stopped = False
    while not stopped:
        snapshot, stopped = past.simulation.step()
        missing.append(lacking(snapshot))
        _note_victims(victims, snapshot)
        if snapshot.tick and snapshot.tick % every == 0:
            there = zip(snapshot.nodes.tolist(), snapshot.xy_m.tolist(), snapshot.present.tolist(), strict=True)
            places[str(snapshot.tick)] = {str(robot): (xy_m[0], xy_m[1]) for robot, xy_m, present in there if present}
    return {"missing": missing, "places": places, "victims": victims, **_end(past)}


def fail(past: Past, branch: Branch, failure: Failure) -> dict[str, Any]:
    """A branch whose last fault is the failure of a robot; returns what it led to, in JSON types."""
    watch = _Watch(branch.tick, branch.tick + tick_of(failure.for_s or 0.0), tick_of(failure.horizon_s))
    victims: dict[str, int] = {}
    orphans: int | None = None
    stopped = False
    while not stopped and (failure.to_end or not watch.ended):
        snapshot, stopped = past.simulation.step()
        _note_victims(victims, snapshot)
        if not watch.ended:
            watch.add(snapshot, stopped=stopped)
        if orphans is None:  # whom the failure cuts off is settled in its own tick
            orphans = len(past.simulation.world.final()["recoveries"][-1]["orphaned"])
    recovered = watch.last < watch.now
    return {
        "orphans": orphans,
        "recovered": recovered,
        "back_s": seconds_of(watch.last + 1 - watch.begun) if recovered else None,
        "without_path_robot_s": seconds_of(watch.missed),
        "watched_s": seconds_of(watch.now + 1 - watch.begun),
        "ended": watch.ended,
        **({"victims": victims, **_end(past)} if failure.to_end else {}),
    }


class _Watch:
    """Who has no path after a failure."""

    def __init__(self, begun: int, back: int, horizon: int) -> None:
        """`back`: tick at which the robot itself is to be there again; `horizon`: ticks to watch at most."""
        self.begun = begun
        self._back, self._horizon = back, horizon
        self.last = begun - 1
        """The last tick in which somebody had none."""
        self.now = begun - 1
        self.missed = 0
        self.ended = ""
        """Why: back, horizon, or mission (its end)."""

    def add(self, snapshot: Snapshot, *, stopped: bool) -> None:
        missing = lacking(snapshot)
        self.missed += missing
        self.now = snapshot.tick
        if missing or snapshot.tick < self._back:
            self.last = snapshot.tick
        if self.now - self.last >= tick_of(STEADY_S):
            self.ended = "back"
        elif self.now + 1 - self.begun >= self._horizon:
            self.ended = "horizon"
        elif stopped:
            self.ended = "mission"


def _note_victims(victims: dict[str, int], snapshot: Snapshot) -> None:
    for victim in snapshot.victims_found:
        victims.setdefault(str(victim), snapshot.tick)


def _end(past: Past) -> dict[str, Any]:
    finals = past.simulation.finals()
    return {
        "status": finals["world"]["status"],
        "ticks": finals["world"]["ticks"],
        "search_time_s": finals.get("station", {}).get("search_time_s", {}).get("all"),
    }
