"""A process of a run, on its own side: what it becomes before it does its work, and how it ends."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import multiprocessing.forkserver
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import connection, reduction
from pathlib import Path
from typing import IO, Any, Final

from setproctitle import setproctitle

from deploy.failures import Crash
from deploy.machine.interrupts import SIGNALS, TO_ALL
from deploy.machine.outlet import keep_writing, lost
from deploy.processes.collector import collect_rarely

__all__ = ["GRACE_S", "Child", "Held"]

GRACE_S: Final = 3.0
"""Wall time that a process has between SIGTERM and SIGKILL, to close its files."""

_PR_SET_PDEATHSIG: Final = 1


class Held:
    """A file of the launcher's that a child gets with its arguments, and holds open until it ends."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return Held._arrived, (reduction.DupFd(self._file.fileno()),)

    @classmethod
    def _arrived(cls, sent: Any) -> Held:
        return cls(os.fdopen(sent.detach(), "rb"))


@dataclass(frozen=True)
class Child:
    """What a process needs to become one of the run's."""

    title: str
    log: Path
    processor: int | None
    words: connection.Connection
    held: Held | None

    def run(self, target: Callable[..., None], args: tuple[Any, ...]) -> None:
        """First function of every process."""
        for number in TO_ALL:
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        if self.processor is not None:
            # Before there are other threads, which inherit it. A processor may have been taken from us meanwhile.
            with contextlib.suppress(OSError):
                os.sched_setaffinity(0, {self.processor})
        unwritten = self._open_log()
        setproctitle(self.title)
        collect_rarely()
        _let_fork_server_go()
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGCONT), 0, 0, 0)
        threading.Thread(target=_end_with_launcher, name="lifeline", daemon=True).start()
        words: list[str] = []
        crash: Crash | None = None
        try:
            target(*args)
        except SystemExit as end:
            if not isinstance(end.code, str):
                raise
            words.append(end.code)  # it ended in order, but for what it says
        except Exception as error:
            traceback.print_exc()
            crash = Crash.of(error)
            raise SystemExit(1) from None
        finally:
            if why := unwritten or next(iter(lost().values()), None):
                words.append(f"logs/{self.log.name} could not be written: {why}")
            if words or crash:
                with contextlib.suppress(OSError):  # the launcher is gone
                    self.words.send(("; ".join(words), crash))

    def _open_log(self) -> str | None:
        """Let this process print into its log; returns why it can't."""
        why = None
        try:
            log = os.open(self.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        except OSError as error:
            why, log = error.strerror, os.open(os.devnull, os.O_WRONLY)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
        keep_writing()
        return why


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
