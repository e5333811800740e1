"""Processes of one run: started by a fork server, named, logged, watched, and never left behind.

The fork server imports the heavy modules once and opens nothing, so a child starts in milliseconds. A child ends
with its launcher, however that one dies: it waits on a pipe that the launcher holds open. A *stopped* child cannot
wait on anything, so the kernel is asked to continue it when the fork server goes (which goes with the launcher).
Nothing here knows what the processes do.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import multiprocessing.forkserver
import os
import selectors
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from setproctitle import setproctitle

from deploy.processes.collector import collect_rarely

__all__ = ["GRACE_S", "Exit", "Supervisor"]

GRACE_S: Final = 3.0
"""Wall time that a process has between SIGTERM and SIGKILL, to close its files."""

_PR_SET_PDEATHSIG: Final = 1
_WAKE: Final = ""
"""No process has this name."""
_ONE_THREAD: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Exit:
    """How a process ended."""

    name: str
    pid: int
    code: int
    """Its exit status, or minus the signal that ended it."""

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

    Not thread-safe but for `wake`.
    """

    def __init__(self, run: str, logs: Path, preload: Sequence[str] = (), places: Mapping[str, int] = {}) -> None:
        """Prepare; the fork server starts as the context is entered.

        Args:
            run: its name, for the titles of processes.
            logs: folder for a file per process.
            preload: modules that the fork server imports.
            places: processors by process name; whoever has none runs where the kernel likes.
        """
        self._run = run
        self._logs = logs
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(preload))
        self._places = places
        self._living: dict[str, BaseProcess] = {}
        self._wake_r, self._wake_w = os.pipe()
        os.set_blocking(self._wake_r, False)
        os.set_blocking(self._wake_w, False)
        self._watched = selectors.DefaultSelector()
        """Whose end is waited for: names by sentinel, and the wake-up call."""
        self._watched.register(self._wake_r, selectors.EVENT_READ, _WAKE)

    def start(self, name: str, target: Callable[..., None], *args: Any) -> int:
        """Start `target(*args)` as process `name` and return its pid. Target and arguments must be picklable.

        Raises:
            ValueError: a process of that name is alive.
        """
        if name in self._living:
            raise ValueError(f"{name} is alive already")
        entry = (f"vds {name} {self._run}", self.log_path(name), self._places.get(name), target, args)
        process = self._context.Process(target=_child, args=entry, name=name, daemon=True)
        process.start()
        self._living[name] = process
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
        """Send a signal; False if there is no such process (any more)."""
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
        """Let a `wait` under way return; for other threads and signal handlers."""
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self._wake_w, b"w")

    def wait(self, timeout_s: float | None = None) -> list[Exit]:
        """Sleep until a process ends, `wake` is called, or the time is over; return the ends since the last call."""
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
        # Whoever still calls `wake` must not write into a file that gets the same number.
        wake_w, self._wake_w = self._wake_w, -1
        os.close(wake_w)
        os.close(self._wake_r)

    def _reap(self, name: str) -> Exit:
        process = self._living.pop(name)
        self._watched.unregister(process.sentinel)
        process.join()
        end = Exit(name, process.pid or 0, process.exitcode if process.exitcode is not None else 255)
        process.close()
        return end


def _start_fork_server() -> None:
    """Start the fork server with SIGINT ignored, which all its children then inherit, and one BLAS thread each."""
    os.environ.update(_ONE_THREAD)
    # Python 3.11's fork server does not take over sys.path, so a package that is not installed must be named.
    root = str(Path(__file__).resolve().parent.parent.parent)
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if root not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join(p for p in [root, *paths] if p)
    in_main_thread = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main_thread else None
    safe = os.environ.get("PYTHONSAFEPATH")
    # A folder `world` or `agents` where the user happens to be must not stand for ours.
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        multiprocessing.forkserver.ensure_running()
    finally:
        os.environ.pop("PYTHONSAFEPATH")
        if safe is not None:
            os.environ["PYTHONSAFEPATH"] = safe
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _child(title: str, log: Path, processor: int | None, target: Callable[..., None], args: tuple[Any, ...]) -> None:
    """First function of every process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if processor is not None:
        # Before there are other threads, which inherit it. A processor may have been taken from us meanwhile.
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, {processor})
    with log.open("ab", buffering=0) as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    setproctitle(title)
    collect_rarely()
    _let_fork_server_go()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGCONT), 0, 0, 0)
    threading.Thread(target=_end_with_launcher, name="lifeline", daemon=True).start()
    target(*args)


def _let_fork_server_go() -> None:
    """Close this child's copy of the pipe that keeps the fork server alive: only the launcher shall do that.

    There is no public name for it; without this, one stopped child would keep the fork server, and the fork server's
    end is what lets the kernel continue the child.
    """
    server = getattr(multiprocessing.forkserver, "_forkserver", None)
    held = getattr(server, "_forkserver_alive_fd", None)
    if held is not None:
        os.close(held)


def _end_with_launcher() -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("a supervised process has a parent")
    connection.wait([parent.sentinel])
    print("the launcher is gone: this process ends", file=sys.stderr)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(1)
