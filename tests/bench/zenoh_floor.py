"""The floor over Zenoh: the emulator's own shells, session, keys and access rules around cores that do nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bus.access import Login, credentials, users_of
from bus.member import Member
from bus.nodes import process_name, user_name
from bus.session import Session, local_endpoint
from deploy.processes.supervisor import Supervisor
from medium.config import MediumConfig
from medium.messages import BROADCAST, Frame, Inbox, Transmission
from medium.process import Shell as MediumShell
from tests.bench.pattern import Pattern, TickTimes
from world.account import Told
from world.config import Fault, WorldConfig
from world.core import Begin
from world.feed import Snapshot
from world.grid import GridGeometry
from world.messages import Motion, Positions, Report, Sense, Status, Stop
from world.process import Shell as WorldShell
from world.terms import STATION

__all__ = ["start"]


def start(pattern: Pattern, supervisor: Supervisor, result: Path) -> None:
    """Start all processes of the floor; the world writes `result` at the end."""
    logins = credentials("floor", local_endpoint(result.parent, pattern.robots), pattern.robots)
    supervisor.start("medium", _medium, pattern, logins["medium"], users_of(logins))
    supervisor.start("world", _world, pattern, logins["world"], result)
    for node in pattern.nodes:
        supervisor.start(process_name(node), _node, pattern, logins[user_name(node)], node)


class _World:
    """Sends the senses of the pattern and judges nothing."""

    def __init__(self, pattern: Pattern, times: TickTimes) -> None:
        n = pattern.robots
        self._pattern, self._times = pattern, times
        self._present: set[int] = set()
        self._over = False
        self.tick = 0
        self._nodes = np.arange(n + 1, dtype=np.int16)
        self._xy = np.zeros((n + 1, 2))
        self._scan = np.ones(pattern.beams)
        bytes_n, ids_n = np.zeros(n, np.uint8), np.zeros(n, np.int16)
        self._snapshot = Snapshot(
            0, self._nodes[1:], bytes_n, self._xy[1:], bytes_n, bytes_n, bytes_n, ids_n, ids_n, self._xy[1:]
        )

    def awaited(self) -> frozenset[int]:
        return frozenset() if self.tick else frozenset(self._pattern.nodes) - self._present

    def arrive(self, node: int, *, new: bool) -> None:  # noqa: ARG002  # World's signature
        self._present.add(node)

    def depart(self, node: int, cause: str, *, counted: bool) -> None:  # noqa: ARG002
        raise RuntimeError(f"node {node} left the floor: {cause}")

    def begin(self) -> Begin:
        self._over = not self._times.tick()
        tick, first = self.tick, self.tick == 0
        senses = {
            node: Sense(
                tick, first, 0, 0.0, 0.0, self._scan if self._pattern.sense_bytes(node, tick) > 100 else None
            )
            for node in self._pattern.nodes
        }  # fmt: skip
        return Begin(tick, senses, Positions(tick, self._nodes, self._xy), ())

    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None:  # noqa: ARG002
        self.tick += 1
        return Stop(self.tick - 1, "time_limit") if self._over else None

    def tell(self) -> Told:
        return Told(self._snapshot, ())

    def inject(self, fault: Fault) -> None:
        raise RuntimeError(f"a fault on the floor: {fault}")

    def interrupt(self) -> None:
        self._over = True

    def fail(self, why: str) -> Stop:  # noqa: ARG002
        return Stop(self.tick, "failed")

    def final(self) -> dict[str, Any]:
        self._times.write()
        return {}


class _Medium:
    """Gives every node the same inbox."""

    def __init__(self, pattern: Pattern) -> None:
        self._heard = tuple((1, -40.0, bytes(pattern.frame_bytes)) for _ in range(pattern.heard))

    def step(self, positions: Positions, transmissions: Mapping[int, Transmission]) -> dict[int, Inbox]:
        return {node: Inbox(positions.tick + 1, self._heard) for node in transmissions}

    def final(self) -> dict[str, Any]:
        return {}


class _Node:
    """Sends the same frames in every tick."""

    def __init__(self, pattern: Pattern, node: int) -> None:
        self._node = node
        self._frames = ((BROADCAST, bytes(pattern.frame_bytes)),)

    def step(self, sense: Sense) -> tuple[tuple[Frame, ...], Motion | Report]:
        if self._node == STATION:
            return self._frames, Report(sense.tick, False, (), 0)
        return self._frames, Motion(sense.tick, 0.0, 0.0, Status())


def _world(pattern: Pattern, login: Login, result: Path) -> None:
    config = WorldConfig(
        seed=0, robots=pattern.robots, geometry=GridGeometry(1, 1), occupied=np.zeros((1, 1), bool),
        station_m=(0.0, 0.0), starts_m=np.zeros((pattern.robots, 2)), top_speed_m_s=1.0, duration_s=1e6,
    )  # fmt: skip
    WorldShell(_World(pattern, TickTimes(result, pattern.wall_s)), config, login).run()


def _medium(pattern: Pattern, login: Login, users: Mapping[str, str]) -> None:
    config = MediumConfig(
        seed=0, robots=pattern.robots, cells=0, radius_m=1.0, geometry=GridGeometry(1, 1),
        occupied=np.zeros((1, 1), bool),
    )  # fmt: skip
    with Session.host(login, users) as session:
        MediumShell(_Medium(pattern), config, session, hosts=True).run()


def _node(pattern: Pattern, login: Login, node: int) -> None:
    member = Member(login, "robot" if node else "station", node, Sense.decode, Inbox.decode)
    core = _Node(pattern, node)
    with member:
        while (turn := member.turn()) is not None:
            sense, _ = turn
            frames, motion = core.step(sense)
            member.answer(sense.tick, Transmission(sense.tick, node, frames).encode(), motion.encode())
