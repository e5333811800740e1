"""A world driven by given motions, in the same order as an in-process simulation drives it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from world.config import WorldConfig
from world.core import Begin, World
from world.feed import Event, Signal, Snapshot
from world.grid import GridGeometry
from world.messages import Motion, Report, Status, Stop
from world.terms import Cls

GEOMETRY = GridGeometry(40, 40, 0.5)
ROOM = np.zeros((40, 40), np.bool_)
ROOM[20, 4:36] = True  # y 10.0 to 10.5, x 2 to 18


def config(robots: int = 4, **changes: Any) -> WorldConfig:
    starts = np.array([[3.0 + i, 5.0] for i in range(robots)])
    base = WorldConfig(
        seed=1,
        robots=robots,
        geometry=GEOMETRY,
        occupied=ROOM,
        station_m=(2.25, 5.0),
        starts_m=starts,
        top_speed_m_s=2 / 3.6,
        duration_s=1000.0,
    )
    return dataclasses.replace(base, **changes)


def chain(node: int) -> Status:
    """Robot 1 hears the MS, robot 2 hears robot 1, and so on; the last one searches."""
    return Status(cls=Cls.RR, nms=node - 1, hops=node)


class End(NamedTuple):
    """The result of a tick."""

    snapshot: Snapshot
    events: tuple[Event, ...]
    stop: Stop | None


class Run:
    """Drives a world as an in-process simulation does."""

    def __init__(self, made: WorldConfig, status: Callable[[int], Status] = chain) -> None:
        self.world = World(made)
        self.status = {n: status(n) for n in range(1, made.robots + 1)}
        last = made.robots
        if last:
            self.status[last] = dataclasses.replace(self.status[last], cls=Cls.SR)
        self.velocity: dict[int, tuple[float, float]] = {}
        self.begun: list[Begin] = []
        self.ended: list[End] = []

    def tick(self, *, report: Report | None = None, arrive: bool = True) -> End:
        if arrive:
            for node in sorted(self.world.awaited()):
                self.world.arrive(node, new=True)
        self.begun.append(self.world.begin())
        return self.end(self.motions(), report)

    def end(self, motions: dict[int, Motion], report: Report | None = None) -> End:
        stop = self.world.end(motions, report)
        told = self.world.tell()
        self.ended.append(End(told.snapshot, told.events, stop))
        return self.ended[-1]

    def motions(self) -> dict[int, Motion]:
        tick = self.begun[-1].tick
        roster = [n for n in self.begun[-1].senses if n]
        return {n: Motion(tick, *self.velocity.get(n, (0.0, 0.0)), self.status[n]) for n in roster}

    def until(self, tick: int) -> End:
        while self.world.tick <= tick:
            self.tick()
        return self.ended[-1]

    @property
    def signals(self) -> list[Signal]:
        return [signal for begin in self.begun for signal in begin.signals]

    @property
    def faults(self) -> list[Event]:
        return [event for end in self.ended for event in end.events if event.kind == "fault"]

    def present_at(self, node: int) -> list[int]:
        return [begin.tick for begin in self.begun if node in begin.senses]
