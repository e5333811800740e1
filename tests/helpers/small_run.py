"""A run of real processes with almost empty cores, for tests of how they keep step.

World and medium are the real ones; robots and station answer every tick with one short frame.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import numpy as np

import agents.process
import medium.process
import monitor_station.process
import world.process
from bus.access import users_of
from bus.keys import Keys
from bus.session import Login, Mailbox, Session, credentials, local_endpoint
from medium.config import MediumConfig
from medium.messages import BROADCAST, Frame, Inbox
from tests import ROOT
from world.config import Lidar, WorldConfig
from world.core import World
from world.feed import Absence, Event, Signal, Snapshot, unpack_feed
from world.grid import UNKNOWN, GridGeometry
from world.messages import Motion, Report, Sense, Status, Stop
from world.terms import STATION

# Python 3.11's fork server does not take over sys.path. An empty entry would be the working folder.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
PROCESSES = multiprocessing.get_context("forkserver")
BROKEN = 13
"""The seed of a world whose core raises."""

GRID = GridGeometry(80, 80)
ODD_TICK = 20
THINKS_S = 4.0


class Speaker:
    """Stands for a robot or the station: sends its incarnation and the number of frames that it heard."""

    def __init__(self, *core: Any) -> None:
        """What a core is given: its configuration and more, then its incarnation and its first tick."""
        *_, incarnation, _ = core
        self._incarnation = incarnation

    def _frames(self, inbox: Inbox | None) -> tuple[Frame, ...]:
        heard = len(inbox.receptions) if inbox is not None else 0
        return ((BROADCAST, bytes([self._incarnation, heard])),)

    def table(self) -> None:
        """Show nothing."""


class BadSpeaker(Speaker):
    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:  # noqa: ARG002
        raise ZeroDivisionError(f"at tick {sense.tick}")


class RobotSpeaker(Speaker):
    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:
        return self._frames(inbox), Motion(sense.tick, 0.1, 0.0, Status())


class OddSpeaker(RobotSpeaker):
    """Does something odd in one tick before it answers."""

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:
        if sense.tick == ODD_TICK:
            self.odd()
        return super().step(sense, inbox)

    def odd(self) -> None:
        raise NotImplementedError


class Thinker(OddSpeaker):
    def odd(self) -> None:
        until_s = time.process_time() + THINKS_S
        while time.process_time() < until_s:
            pass


class Endless(OddSpeaker):
    def odd(self) -> None:
        while True:
            pass


class Waiter(OddSpeaker):
    """Waits for something that does not come, and looks for it from time to time."""

    def odd(self) -> None:
        while True:
            time.sleep(0.1)


class LockHolder(OddSpeaker):
    """Compiled code that keeps the interpreter's lock, so no other thread of the process runs."""

    def odd(self) -> None:
        ctypes.PyDLL(None).sleep(3600)


class StationSpeaker(Speaker):
    merger = SimpleNamespace(cells=np.full(GRID.size, UNKNOWN, np.int8), merged=0)

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Report]:
        return self._frames(inbox), Report(sense.tick, False, (0.0,), 0)

    def journal(self) -> bytes:
        return b"."

    def restore(self, journal: bytes) -> int:
        assert set(journal) == {ord(".")}
        return len(journal)

    def final(self) -> dict[str, Any]:
        return {"spoke": True}


def robot_process(node: int, login: Login, core: type[Speaker], log: str) -> None:
    _into(log)
    agents.process.Robot = core  # type: ignore[attr-defined,misc,assignment]
    config = SimpleNamespace(node=node, seed=1, policy="vds", lidar_beams=Lidar().beams, robots=9)
    agents.process.run(config, login)  # type: ignore[arg-type]


def station_process(login: Login, out: str, log: str) -> None:
    _into(log)
    monitor_station.process.Station = StationSpeaker  # type: ignore[attr-defined,misc,assignment]
    config = SimpleNamespace(node=SimpleNamespace(node=STATION, seed=1, geometry=GRID, robots=9))
    monitor_station.process.run(config, login, None, Path(out))  # type: ignore[arg-type]


def medium_process(config: MediumConfig, login: Login, users: dict[str, str], log: str) -> None:
    _into(log)
    medium.process.run(config, login, users)


def rogue_process(act: Callable[[Login, int], None], login: Login, node: int, log: str) -> None:
    _into(log)
    act(login, node)


class BrokenWorld(World):
    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None:
        if self.tick == 50:
            raise ZeroDivisionError("at tick 50")
        return super().end(motions, report)


def world_process(config: WorldConfig, login: Login, log: str) -> None:
    _into(log)
    if config.seed == BROKEN:
        world.process.World = BrokenWorld  # type: ignore[misc]
    world.process.run(config, login)


def _into(log: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Path(log).open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)


class SmallRun:
    """Processes of one run, and the messages that a launcher receives."""

    def __init__(self, folder: Path, robots: int = 3, cores: Mapping[int, type[Speaker]] = {}, **config: Any) -> None:
        self.folder = folder
        self.cores = cores
        self.logins = credentials("small", local_endpoint(folder, robots), robots)
        free = np.zeros((GRID.rows, GRID.cols), np.bool_)
        self.world = WorldConfig(
            **{
                "seed": 1,
                "robots": robots,
                "geometry": GRID,
                "occupied": free,
                "station_m": (20.0, 20.0),
                "starts_m": np.array([(15.0, 20.0 + i) for i in range(robots)]),
                "top_speed_m_s": 0.5,
                "duration_s": 1e6,
                "lidar": Lidar(interval_ticks=10**6),
                "cell_names": ("all",),
            }
            | config
        )
        self.medium = MediumConfig(
            seed=1, robots=robots, cells=len(self.world.cell_names), radius_m=50.0, geometry=GRID, occupied=free
        )
        self.processes: dict[str, BaseProcess] = {}
        self.finals: dict[str, dict[str, Any]] = {}
        self.events: list[Event] = []
        self.signals: list[Signal] = []
        self.snapshots: list[Snapshot] = []
        self._latest: dict[int, str] = {}
        """By node: the process that was started last."""
        self._mailbox = Mailbox()
        self._operator: Session | None = None

    def start(self, *, absent: int | None = None) -> None:
        # What the fork server has imported, no child imports again.
        PROCESSES.set_forkserver_preload(["pytest", "tests.helpers.small_run"])
        self._start("medium", medium_process, self.medium, self.logins["medium"], users_of(self.logins))
        self.start_station("station")
        for node in range(1, self.world.robots + 1):
            if node != absent:
                self.start_robot(node)
        self._operator = session = Session.connect(self.logins["operator"], watching=True)
        session.subscribe(self._mailbox, session.keys.final("*"), session.keys.feed)
        session.subscribe(self._mailbox, session.keys.event, session.keys.signal)
        self._start("world", world_process, self.world, self.logins["world"])

    def start_robot(self, node: int, name: str | None = None) -> None:
        core = self.cores.get(node, RobotSpeaker)
        self._latest[node] = name or f"robot-{node}"
        self._start(name or f"robot-{node}", robot_process, node, self.logins[f"robot-{node}"], core)

    def start_station(self, name: str) -> None:
        self._latest[STATION] = name
        self._start(name, station_process, self.logins["station"], str(self.folder))

    def start_rogue(self, act: Callable[[Login, int], None], node: int) -> None:
        """Start a process that does something with the password of a robot (tests/helpers/rogue.py)."""
        self._start("rogue", rogue_process, act, self.logins[f"robot-{node}"], node)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def signal(self, name: str, number: int) -> None:
        pid = self.processes[name].pid
        assert pid is not None
        os.kill(pid, number)

    def command(self, line: str) -> str:
        assert self._operator is not None
        return self._operator.ask(self._operator.keys.control, line)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Read the messages of the run until a condition holds, for as long as the test may take."""
        try:
            while not condition():
                message = self._mailbox.get(0.05)
                if message is not None:
                    self._take(*message)
        except BaseException as error:
            logs = {path.name: path.read_text()[-500:] for path in self.folder.glob("*.log")}
            error.add_note(f"waited for: {what}; last words of {list(self.finals)}; {logs}")
            raise

    def ticks(self, count: int) -> None:
        """Let the run go on for at least `count` ticks."""
        end = self.tick + count
        self.until(lambda: self.tick >= end, f"tick {end}")

    @property
    def tick(self) -> int:
        return self.snapshots[-1].tick if self.snapshots else 0

    def present(self, node: int) -> bool:
        return bool(self.snapshots and self.snapshots[-1].present[node - 1])

    def exit_codes(self, *names: str) -> list[int | None]:
        """How the named processes ended, which it waits for."""
        self.until(lambda: all(self.processes[n].exitcode is not None for n in names), f"end of {names}")
        return [self.processes[name].exitcode for name in names]

    def interrupt(self) -> None:
        """End the run and wait for the last words."""
        self.command("interrupt")
        self.until(lambda: len(self.finals) == 3, "the final counts")

    def close(self) -> None:
        if self._operator is not None:
            self._operator.close()
        for process in self.processes.values():
            process.kill()
            process.join()
            process.close()

    def _start(self, name: str, target: Callable[..., None], *args: Any) -> None:
        log = str(self.folder / f"{name}.log")
        process = PROCESSES.Process(target=target, args=(*args, log), name=name, daemon=True)
        process.start()
        self.processes[name] = process

    def _obey(self, order: Signal) -> None:
        """As a launcher would, but for signals, which nobody gets."""
        if order.verb != "look":
            self.signals.append(order)
        elif order.node in self._latest and self.processes[self._latest[order.node]].exitcode is not None:
            assert self._operator is not None
            self._operator.publisher(self._operator.keys.absence, blocking=True)(Absence(order.node, True).encode())

    def _take(self, key: str, data: bytes | None) -> None:
        assert data is not None
        kind, process = Keys.kind_of(key)
        if kind == "final":
            self.finals[process] = msgpack.unpackb(data)
        elif kind == "event":
            self.events.append(Event.decode(data))
        elif kind == "signal":
            self._obey(Signal.decode(data))
        else:
            self.snapshots += unpack_feed(data)


@contextlib.contextmanager
def small_run(
    robots: int = 3, *, absent: int | None = None, cores: Mapping[int, type[Speaker]] = {}, **config: Any
) -> Iterator[SmallRun]:
    """A started run whose first ticks have passed (unless a robot is absent); its processes end with the context."""
    with tempfile.TemporaryDirectory() as folder:
        run = SmallRun(Path(folder), robots, cores, **config)
        try:
            run.start(absent=absent)
            if absent is None:
                run.until(lambda: run.tick > 0, "the first ticks")
            yield run
        finally:
            run.close()
