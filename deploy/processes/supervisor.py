"""Processes of one run: started by a fork server, named, logged, watched, and never left behind.

The fork server imports the heavy modules once and opens nothing, so a child starts in milliseconds. A child ends with
its launcher, however that dies: it waits on a pipe that the launcher holds open. A *stopped* child cannot wait, so the
kernel continues it when the fork server ends, which ends with the launcher. This module does not know what processes
do. What is sent to a whole process group, as by a terminal, is for the launcher alone to judge.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import os
import selectors
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from deploy.failures import Crash
from deploy.machine.interrupts import SIGNALS
from deploy.machine.limits import one_thread
from deploy.processes.child import GRACE_S, Child, Held

__all__ = ["Exit", "Supervisor"]

_WAKE: Final = ""
"""No process has this name."""


@dataclass(frozen=True, slots=True)
class Exit:
    """How a process ended."""

    name: str
    pid: int
    code: int
    """Its exit status, or minus the signal that ended it."""
    words: str = ""
    """What did not go well although it ended in order, in one line: the message of its SystemExit, such as a file that
    it could not write."""
    crash: Crash | None = None
    """The exception that ended it."""

    @property
    def by_signal(self) -> bool:
        return self.code < 0

    def __str__(self) -> str:
        how = f"ended by {_signal_name(-self.code)}" if self.by_signal else f"exited with status {self.code}"
        return f"{self.name} (pid {self.pid}) {how}"


def _signal_name(number: int) -> str:
    """Real-time signals have no names of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


class Supervisor:
    """Starts named processes and reports their ends. A context manager: on leaving, no process is left.

    Only `wake` is thread-safe.
    """

    def __init__(
        self,
        run: str,
        logs: Path,
        preload: Sequence[str] = (),
        processors: Mapping[str, int] = {},
        held: IO[bytes] | None = None,
    ) -> None:
        """Prepare; the fork server starts as the context is entered.

        Args:
            run: its name, for the titles of processes.
            logs: folder for a file per process.
            preload: modules that the fork server imports.
            processors: by name of a process. The kernel chooses for those without one.
            held: a file that every process holds open until it ends, for its lock.

        Raises:
            OSError: the folder or the fork server can't be made.
        """
        self._run = run
        self._logs = logs
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(preload))
        self._processors = processors
        self._held = None if held is None else Held(held)
        self._living: dict[str, BaseProcess] = {}
        self._words: dict[str, connection.Connection] = {}
        """By process: where its last words arrive."""
        self._wake_r, self._wake_w = os.pipe()
        os.set_blocking(self._wake_r, False)
        os.set_blocking(self._wake_w, False)
        self._watched = selectors.DefaultSelector()
        """Sentinels of living processes, with their names, and the pipe of `wake`."""
        self._watched.register(self._wake_r, selectors.EVENT_READ, _WAKE)

    def start(self, name: str, target: Callable[..., None], *args: Any) -> int:
        """Start `target(*args)` as process `name` and return its pid. Target and arguments must be picklable.

        Raises:
            ValueError: a process of that name is alive.
        """
        if name in self._living:
            raise ValueError(f"{name} is alive already")
        heard, words = self._context.Pipe(duplex=False)
        child = Child(f"vds {name} {self._run}", self.log_path(name), self._processors.get(name), words, self._held)
        process = self._context.Process(target=child.run, args=(target, args), name=name, daemon=True)
        process.start()
        words.close()
        self._living[name], self._words[name] = process, heard
        self._watched.register(process.sentinel, selectors.EVENT_READ, name)
        return self.pids[name]

    @property
    def pids(self) -> Mapping[str, int]:
        """Living processes."""
        return {name: p.pid for name, p in self._living.items() if p.pid is not None}

    def log_path(self, name: str) -> Path:
        return self._logs / f"{name.replace('/', '-')}.log"

    def tail(self, name: str, lines: int = 15) -> str:
        """The last lines of a process's log."""
        try:
            text = self.log_path(name).read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return ""
        return "\n".join(text.splitlines()[-lines:])

    def signal(self, name: str, number: signal.Signals) -> bool:
        """Send a signal; False if no process of that name lives."""
        process = self._living.get(name)
        if process is None or process.pid is None or process.exitcode is not None:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)
            return True
        return False

    def stopped(self, name: str) -> bool:
        """Whether a process is there and stopped by a signal."""
        process = self._living.get(name)
        try:
            status = Path(f"/proc/{process.pid if process is not None else 0}/stat").read_text(encoding="utf-8")
        except OSError:
            return False
        return status.rpartition(")")[2].split()[0] == "T"

    def wake(self) -> None:
        """Make a `wait` under way return. Other threads and signal handlers may call it."""
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self._wake_w, b"w")

    def wait(self, timeout_s: float | None = None) -> list[Exit]:
        """Sleep until a process ends, `wake` is called, or the time is over; returns the ends since the last call."""
        ready = [key.data for key, _ in self._watched.select(timeout_s)]
        if _WAKE in ready:
            ready.remove(_WAKE)
            with contextlib.suppress(BlockingIOError):
                os.read(self._wake_r, 65_536)
        return [self._reap(name) for name in ready]

    def end(self, name: str) -> Exit | None:
        """Kill one process and wait until it is gone; None if there was none."""
        if name not in self._living:
            return None
        self._living[name].kill()
        return self._reap(name)

    def stop(self, grace_s: float = GRACE_S) -> list[Exit]:
        """End all processes: SIGTERM, and SIGKILL for those that are still there after `grace_s`."""
        for name, process in self._living.items():
            process.terminate()
            self.signal(name, signal.SIGCONT)
        ends: list[Exit] = []
        deadline = time.monotonic() + grace_s
        while self._living and (left := deadline - time.monotonic()) > 0:
            ends += self.wait(left)
        for process in self._living.values():
            process.kill()
        return ends + [self._reap(name) for name in list(self._living)]

    def __enter__(self) -> Self:
        self._logs.mkdir(parents=True, exist_ok=True)
        _start_fork_server()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.stop()
        self._watched.close()
        # A late call of `wake` must not write into a file that gets the same descriptor.
        wake_w, self._wake_w = self._wake_w, -1
        os.close(wake_w)
        os.close(self._wake_r)

    def _reap(self, name: str) -> Exit:
        process = self._living.pop(name)
        self._watched.unregister(process.sentinel)
        process.join()
        code = process.exitcode if process.exitcode is not None else 255
        end = Exit(name, process.pid or 0, code, *_last_words(self._words.pop(name)))
        process.close()
        return end


def _last_words(heard: connection.Connection) -> tuple[str, Crash | None]:
    with heard, contextlib.suppress(EOFError, OSError):
        if heard.poll():
            words, crash = heard.recv()
            return words, crash
    return "", None


def _start_fork_server() -> None:
    """Start the fork server, with one BLAS thread for each of its children, and deaf to what a whole group is sent."""
    one_thread()
    try:
        os.getcwd()  # noqa: PTH109  # multiprocessing asks in these words
    except FileNotFoundError:  # it was deleted, so no relative path leads anywhere: any other folder will do
        os.chdir("/")
    # Python 3.11's fork server does not take over sys.path, so a package that is not installed must be named.
    root = str(Path(__file__).resolve().parent.parent.parent)
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if root not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join(p for p in [root, *paths] if p)
    safe = os.environ.get("PYTHONSAFEPATH")
    # A folder `world` or `agents` in the user's working directory must not shadow ours.
    os.environ["PYTHONSAFEPATH"] = "1"
    # A program inherits the signals that are blocked. While they are blocked here, none is lost to this process either.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        multiprocessing.resource_tracker.ensure_running()  # which ends by unblocking some
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        multiprocessing.forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.environ.pop("PYTHONSAFEPATH")
        if safe is not None:
            os.environ["PYTHONSAFEPATH"] = safe
