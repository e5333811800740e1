"""Executes the runs of a study by `concurrent.futures`: on processes of this machine, or on a Dask cluster.

Only this process writes results, so workers need no shared disk. A worker that is lost costs the runs under way on it.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Final, Protocol

from deploy.machine.interrupts import TO_ALL
from deploy.machine.limits import one_thread
from deploy.machine.scratch import Scratch, home_of_tempfile
from deploy.sweep.plan import Point
from deploy.sweep.row import Engine, Finished, end_after, failed_row, run_point

__all__ = ["CONNECT_S", "DaskCluster", "Execution", "LocalPool", "WorkersGoneError"]

CONNECT_S: Final = 10
"""Wall time within which a Dask scheduler must answer."""


class WorkersGoneError(Exception):
    """No worker can be reached any more; one line for the user. The runs under way there are still to do."""


_OF_WORKER: Final = contextlib.ExitStack()
"""What a worker of a local pool holds until it ends."""


class Workers(Protocol):
    """Where runs are executed."""

    at_once: int | None
    """How many runs to submit at a time. None: all, for a scheduler that queues and retries by itself."""

    @property
    def executor(self) -> Executor:
        """The executor. `renew` replaces it.

        Raises:
            WorkersGoneError: there is none any more.
        """

    def renew(self) -> None:
        """Replace an executor that has lost a worker."""

    def close(self) -> None:
        """End all workers now, even during a run."""


class LocalPool:
    """Processes of this machine. They end with this process, even if it is killed."""

    def __init__(self, workers: int) -> None:
        self.at_once: int | None = workers
        self._workers = workers
        self._context = multiprocessing.get_context("spawn")
        self._open()

    @property
    def executor(self) -> Executor:
        return self._executor

    def renew(self) -> None:
        self.close()
        self._open()

    def close(self) -> None:
        # Workers end when the pipe closes, since a shutdown would wait for runs of minutes. It waits for the executor's
        # thread, which would disturb the end of the interpreter.
        self._lifeline.close()
        self._held.close()
        self._executor.shutdown(cancel_futures=True)

    def _open(self) -> None:
        self._held, self._lifeline = self._context.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(self._workers, self._context, _begin_worker, (self._held,))


class DaskCluster:
    """The workers of a running Dask cluster."""

    at_once: int | None = None

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            OSError: nobody answers at that address.
        """
        import distributed

        # The client logs a traceback when its scheduler ends; one line of ours says so.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        connect: Any = distributed.Client
        self._client = connect(address, timeout=CONNECT_S)
        # Not `pure`, or Dask would return an earlier result for equal arguments.
        self._executor: Executor = self._client.get_executor(pure=False)

    @property
    def executor(self) -> Executor:
        if self._client.status == "closed":
            raise WorkersGoneError("the Dask scheduler is gone")
        return self._executor

    def renew(self) -> None:
        """Nothing to do: the scheduler replaces its workers."""

    def close(self) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()


def _begin_worker(lifeline: Connection) -> None:
    one_thread()
    # Ctrl-C and the end of a terminal reach all its processes; only the study reacts.
    for number in TO_ALL:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=end_after, args=(lifeline,), name="lifeline", daemon=True).start()
    # A worker ends without a word, with its runs under way: what they have in temporary folders goes with it.
    scratch = _OF_WORKER.enter_context(Scratch())
    _OF_WORKER.enter_context(home_of_tempfile(scratch.path))


@dataclass
class Execution:
    """One pass over the runs that are still to do."""

    workers: Workers
    engine: Engine
    series_step_s: int
    run: Callable[[str, str, str, Engine, int], Finished] = run_point
    _suspects: set[str] = field(default_factory=set)
    """Keys of runs that were under way when a worker died."""

    def results(self, points: Sequence[Point]) -> Iterator[tuple[Point, Finished]]:
        """Run all points; yields each as it ends.

        Raises:
            WorkersGoneError: no worker is left. All runs that had ended were yielded before.
        """
        todo = deque(points)
        running: dict[Future[Finished], Point] = {}
        while todo or running:
            lost = not self._hand_over(todo, running)
            done = set(running) if lost else wait(running, return_when=FIRST_COMPLETED).done
            victims: list[Point] = []
            # Only Dask's client cancels runs, when it loses its scheduler.
            cancelled = [future for future in done if future.cancelled()]
            for future in done.difference(cancelled):
                point = running.pop(future)
                finished = self._outcome(future, point)
                if finished is None:
                    victims.append(point)
                else:
                    self._suspects.discard(point.key)
                    yield point, finished
            if cancelled:
                raise WorkersGoneError(f"the Dask scheduler is gone, with {len(running)} runs in hand")
            if not lost and not victims:
                continue
            victims += running.values()
            running.clear()
            self.workers.renew()
            # A broken pool does not say which worker died, so each run that was under way is tried once more, alone.
            for point in victims:
                if point.key in self._suspects:
                    yield point, self._lost(point, "its worker process died, twice")
                else:
                    todo.appendleft(point)
            self._suspects.update(point.key for point in victims)

    def _hand_over(self, todo: deque[Point], running: dict[Future[Finished], Point]) -> bool:
        """Submit runs until the workers are busy; False if the executor is broken."""
        room = self.workers.at_once
        while todo and (room is None or len(running) < room):
            point = todo[0]
            if running and (point.key in self._suspects or any(p.key in self._suspects for p in running.values())):
                break
            arguments = (point.key, point.variant, point.toml, self.engine, self.series_step_s)
            try:
                running[self.workers.executor.submit(self.run, *arguments)] = point
            except BrokenProcessPool:
                return False
            todo.popleft()
        return True

    def _outcome(self, future: Future[Finished], point: Point) -> Finished | None:
        """The result of a future; None if its worker was lost."""
        if not future.done():
            return None
        try:
            return future.result()
        except BrokenProcessPool:
            return None
        except Exception as error:  # such as Dask's KilledWorker: the study goes on without this run
            return self._lost(point, f"{type(error).__name__}: {error}")

    def _lost(self, point: Point, words: str) -> Finished:
        return Finished(failed_row(point.key, point.variant, point.toml, self.engine, words), {})
