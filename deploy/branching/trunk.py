"""The common past of many branches, in a process of its own that is forked for each of them.

A fork is an exact copy of a run under way, for as long as no other thread is at work in it. So the trunk runs in a
fresh interpreter that starts none: no bus, no recorder, no numerical library with threads. It refuses to fork
otherwise.

A fork passes its answer to the trunk by a pipe, and the trunk passes it on. When who ordered the branches goes away,
the trunk ends, and its forks with it.
"""

from __future__ import annotations

import gc
import os
import pickle
import selectors
import signal
import struct
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, NoReturn, TypeAlias

from deploy.failures import Crash
from deploy.machine.interrupts import TO_ALL, end_with
from deploy.processes.collector import collect_rarely
from deploy.scenario import Scenario
from deploy.simulation import Simulation
from world.feed import Snapshot

__all__ = ["LENGTH", "Branch", "Order", "Past", "Task", "main"]

LENGTH: Final = struct.Struct("<Q")
"""Bytes of the answer that follows."""
_CHUNK: Final = 2**20
_THREADS: Final = Path("/proc/self/task")


@dataclass(frozen=True)
class Branch:
    """One future."""

    key: str
    tick: int
    """Where it leaves the trunk."""
    scenario: Scenario
    """That of the trunk, with more faults and changes after its own, none of which acts before `tick`."""


@dataclass
class Past:
    """What a branch begins with: the run up to its tick. The task of the branch runs it on."""

    simulation: Simulation
    snapshots: list[Snapshot]
    """Of all ticks so far if the order keeps them, else of the last one at most."""


Task: TypeAlias = Callable[[Past, Branch], Any]


@dataclass(frozen=True)
class Order:
    """What a trunk is asked for. All of it travels by pickle."""

    scenario: Scenario
    branches: Sequence[Branch]
    task: Task
    """What is done in each branch; its result is the answer."""
    at_once: int
    """Most branches under way."""
    keeps: bool
    """Whether branches get the snapshots of all ticks."""


@dataclass
class _Fork:
    key: str
    pid: int
    told: bytearray = field(default_factory=bytearray)


class Trunk:
    """Runs the common past, and forks where branches leave it."""

    def __init__(self, order: Order, orders: IO[bytes], answers: IO[bytes]) -> None:
        """`orders`: a pipe that ends when nobody waits for the `answers`."""
        self._order, self._orders, self._answers = order, orders, answers
        self._past = Past(Simulation(order.scenario), [])
        self._over = False
        self._forks: dict[int, _Fork] = {}
        """By the descriptor of their answer."""
        self._selector = selectors.DefaultSelector()
        self._selector.register(orders.fileno(), selectors.EVENT_READ)

    def run(self) -> None:
        """Answer all branches, or say why there are no more answers."""
        try:
            self._answer_all()
        except Exception as error:  # such as one of a user's policy
            self._tell("", pickle.dumps((False, Crash.of(error).headline)))

    def _answer_all(self) -> None:
        for branch in sorted(self._order.branches, key=lambda branch: branch.tick):
            self._grow(branch.tick)
            while len(self._forks) >= self._order.at_once:
                self._collect(None)
            self._fork(branch)
        while self._forks:
            self._collect(None)

    def _grow(self, tick: int) -> None:
        past = self._past
        while past.simulation.world.tick < tick and not self._over:
            snapshot, self._over = past.simulation.step()
            if not self._order.keeps:
                past.snapshots.clear()
            past.snapshots.append(snapshot)
            self._collect(0.0)

    def _fork(self, branch: Branch) -> None:
        if len(list(_THREADS.iterdir())) > 1:
            raise RuntimeError("a run can't be branched while it has threads, such as those that a policy starts")
        gc.freeze()
        sys.stdout.flush()  # or each fork would write again what is left to write
        answer, end = os.pipe()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            pid = os.fork()
        if pid == 0:
            self._branch_off(branch, end)
        os.close(end)
        self._forks[answer] = _Fork(branch.key, pid)
        self._selector.register(answer, selectors.EVENT_READ)

    def _branch_off(self, branch: Branch, end: int) -> NoReturn:
        """The life of a forked process."""
        status = 1
        try:
            trunk = os.getppid()
            self._answers.close()
            self._orders.close()
            end_with(trunk)
            with os.fdopen(end, "wb") as pipe:
                pipe.write(pickle.dumps(self._answer(branch)))
            status = 0
        finally:
            sys.stdout.flush()
            os._exit(status)

    def _answer(self, branch: Branch) -> tuple[bool, Any]:
        try:
            past = self._past
            if self._over:  # in this branch the run may go on, as where a fault brings a robot back
                past = Past(Simulation(branch.scenario), [])
            else:
                for fault in branch.scenario.tables.fault[len(self._order.scenario.tables.fault) :]:
                    past.simulation.world.schedule(fault)
                past.simulation.medium.plan(branch.scenario.medium_config().changes, branch.tick)
            return True, self._order.task(past, branch)
        except Exception as error:  # such as one of a user's policy
            return False, Crash.of(error).headline

    def _collect(self, timeout_s: float | None) -> None:
        """Take what forks have told within a time; None waits for the first."""
        for key, _ in self._selector.select(timeout_s):
            if key.fd == self._orders.fileno():
                os._exit(1)  # nobody waits any more; the forks end with this process
            fork = self._forks[key.fd]
            chunk = os.read(key.fd, _CHUNK)
            fork.told += chunk
            if not chunk:
                self._selector.unregister(key.fd)
                os.close(key.fd)
                del self._forks[key.fd]
                _, status = os.waitpid(fork.pid, 0)
                self._take(fork, os.waitstatus_to_exitcode(status))

    def _take(self, fork: _Fork, status: int) -> None:
        how = f"by signal {-status}" if status < 0 else f"with status {status}"
        told = bytes(fork.told) if status == 0 else pickle.dumps((False, f"its process ended {how}"))
        self._tell(fork.key, told)

    def _tell(self, key: str, told: bytes) -> None:
        answer = pickle.dumps((key, told))
        self._answers.write(LENGTH.pack(len(answer)) + answer)
        self._answers.flush()


def main() -> None:
    """Carry out the order that comes on one descriptor; the answers go to another. Both are arguments."""
    # Ctrl-C and the end of a terminal reach all its processes; only who gave the order reacts.
    for number in TO_ALL:
        signal.signal(number, signal.SIG_IGN)
    orders, answers = (os.fdopen(int(number), mode) for number, mode in zip(sys.argv[1:3], ("rb", "wb"), strict=True))
    (length,) = LENGTH.unpack(orders.read(LENGTH.size))
    order: Order = pickle.loads(orders.read(length))
    collect_rarely()
    Trunk(order, orders, answers).run()


def run_to_the_end(past: Past, _branch: Branch) -> tuple[dict[str, dict[str, Any]], float, list[Snapshot]]:
    """A task: last counts, wall time and snapshots of the whole run."""
    begun = time.perf_counter()
    stopped = False
    while not stopped:
        snapshot, stopped = past.simulation.step()
        past.snapshots.append(snapshot)
    return past.simulation.finals(), time.perf_counter() - begun, past.snapshots
