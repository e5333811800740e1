"""The in-process simulation: plain calls drive the cores of a run, in the same order as processes do.

For the same scenario, faults and seed it gives the same trace digest as the real processes (ARCHITECTURE.md,
invariant 2), so its results hold for them.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.messages import Table
from agents.policies import policy_class
from agents.robot import Robot
from deploy.scenario import Scenario
from medium.core import Medium
from medium.messages import Inbox, Transmission
from monitor_station.core import Station
from monitor_station.view import StationView
from world.core import World
from world.feed import Event, Snapshot
from world.messages import Motion, Sense
from world.seeds import node_stream
from world.terms import STATION


@dataclass
class Observer:
    """Callbacks for what happens in a run; each may be None."""

    snapshot: Callable[[Snapshot], None] | None = None
    event: Callable[[Event], None] | None = None
    view: Callable[[StationView], None] | None = None
    table: Callable[[Table], None] | None = None


@dataclass(frozen=True)
class Traces:
    """What happened, tick by tick; columns follow `robots`."""

    robots: NDArray[np.int16]
    """(n,) ids"""
    present: NDArray[np.uint8]
    """(ticks, n) 1 = took part"""
    xy_m: NDArray[np.float64]
    """(ticks, n, 2) true positions in metres"""
    cls: NDArray[np.uint8]
    """(ticks, n) world.terms.Cls"""
    nms: NDArray[np.int16]
    """(ticks, n) next hop to the MS, -1 without a route"""
    hops: NDArray[np.uint8]
    """(ticks, n) hop count to the MS, 255 without a route"""
    search_rate: NDArray[np.float64]
    """(ticks, cells) 0..1"""

    @classmethod
    def of(cls, snapshots: list[Snapshot]) -> Traces:
        """Stack the snapshots of a run."""
        cells = max((len(s.search_rate) for s in snapshots), default=0)
        rates = np.zeros((len(snapshots), cells))
        for k, snapshot in enumerate(snapshots):
            rates[k, : len(snapshot.search_rate)] = snapshot.search_rate
        stacked = {
            name: np.array([getattr(s, name) for s in snapshots]) for name in ("present", "xy_m", "cls", "nms", "hops")
        }
        return cls(snapshots[0].nodes if snapshots else np.zeros(0, np.int16), **stacked, search_rate=rates)


@dataclass(frozen=True)
class Result:
    """Outcome of a run: last counts of world, medium and station, and the traces."""

    finals: dict[str, dict[str, Any]]
    """By process: world, medium, station."""
    wall_s: float
    snapshots: list[Snapshot] = field(repr=False)

    @property
    def traces(self) -> Traces:
        """The snapshots as arrays."""
        return Traces.of(self.snapshots)

    @property
    def trace_sha256(self) -> str:
        """The trace digest."""
        return str(self.finals["medium"]["trace_sha256"])


class Simulation:
    """One run of a scenario in this process."""

    def __init__(self, scenario: Scenario, observer: Observer | None = None) -> None:
        """Make all cores.

        Raises:
            ValueError: a robot is external; one line.
        """
        if scenario.not_in_process:
            raise ValueError(scenario.not_in_process)
        self._scenario = scenario
        self._observer = observer or Observer()
        self.world = World(scenario.world_config())
        self.medium = Medium(scenario.medium_config())
        self.robots: dict[int, Robot] = {}
        self.station: Station | None = None
        self._policy = policy_class(scenario.tables.policy)
        self._station_config = scenario.station_config()
        self._incarnation: dict[int, int] = {}
        self._journal = bytearray()
        self._inboxes: dict[int, Inbox] = {}

    def run(self) -> Result:
        """Run to the end: searched, or the time limit."""
        started = time.perf_counter()
        snapshots: list[Snapshot] = []
        while True:
            snapshot, stopped = self.step()
            snapshots.append(snapshot)
            if stopped:
                break
        return Result(self.finals(), time.perf_counter() - started, snapshots)

    def finals(self) -> dict[str, dict[str, Any]]:
        """Last counts of world, medium and, if it ever came, station."""
        finals = {"world": self.world.final(), "medium": self.medium.final()}
        if self.station is not None:
            finals["station"] = self.station.final()
        return finals

    def step(self) -> tuple[Snapshot, bool]:
        """Run one tick; returns its snapshot, and whether the run is over."""
        world, watch = self.world, self._observer
        for node in sorted(world.awaited()):
            world.arrive(node, new=True)
        begin = world.begin()
        transmissions: dict[int, Transmission] = {}
        motions: dict[int, Motion] = {}
        report = None
        self._step_unheard(begin.unheard)
        for node, sense in begin.senses.items():
            inbox = None if sense.first else self._inboxes[node]
            if node == STATION:
                station = self._station_for(sense)
                frames, report = station.step(sense, inbox)
                self._journal += station.journal()
                if watch.view is not None:
                    watch.view(station.view())
            else:
                robot = self._robot_for(node, sense)
                frames, motions[node] = robot.step(sense, inbox)
                if watch.table is not None and (table := robot.table()) is not None:
                    watch.table(table)
            transmissions[node] = Transmission(sense.tick, node, frames)
        self._inboxes = self.medium.step(begin.positions, transmissions)
        stop = world.end(motions, report)
        told = world.tell()
        if watch.snapshot is not None:
            watch.snapshot(told.snapshot)
        if watch.event is not None:
            for event in told.events:
                watch.event(event)
        return told.snapshot, stop is not None

    def _step_unheard(self, senses: Mapping[int, Sense]) -> None:
        """The step that a paused node still takes, like a process that is stopped during it."""
        for node, sense in senses.items():
            inbox = None if sense.first else self._inboxes[node]
            if node == STATION:
                station = self._station_for(sense)
                station.step(sense, inbox)
                self._journal += station.journal()
            else:
                self._robot_for(node, sense).step(sense, inbox)

    def _rng(self, sense: Sense, node: int) -> random.Random:
        return node_stream(self._scenario.seed, node, sense.incarnation)

    def _robot_for(self, node: int, sense: Sense) -> Robot:
        if sense.first and self._incarnation.get(node) != sense.incarnation:
            self._incarnation[node] = sense.incarnation
            self.robots[node] = Robot(
                self._scenario.robot_config(node), self._policy, self._rng(sense, node), sense.incarnation, sense.tick
            )
        return self.robots[node]

    def _station_for(self, sense: Sense) -> Station:
        if self.station is None or (sense.first and self._incarnation[STATION] != sense.incarnation):
            self._incarnation[STATION] = sense.incarnation
            self.station = Station(self._station_config, self._rng(sense, STATION), sense.incarnation, sense.tick)
            self.station.restore(bytes(self._journal))
        return self.station
