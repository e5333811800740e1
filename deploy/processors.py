"""The processors of this machine, when a run has more processes than there are of them.

A tick is a chain of short turns, a few of which can run at a time. Two things then cost more than the turns themselves
(docs/performance.md has the numbers): a kernel that wakes everybody on the processor of who woke him, though another
one idles; and in a virtual machine the hypervisor, which may give an idle processor away and be slow to return it.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from setproctitle import setproctitle

__all__ = ["Vigil", "places", "shared", "virtual"]

_AWAKE_S: Final = 0.5
"""Wall time that a sign of life keeps the processors awake: runs that are held or slow let them idle."""


def shared(processes: int) -> tuple[int, ...]:
    """The processors that so many processes have to share; empty if there is one for each, or nobody can tell."""
    if sys.platform != "linux":
        return ()
    processors = tuple(sorted(os.sched_getaffinity(0)))
    return processors if processes > len(processors) else ()


def places(processors: Sequence[int], nodes: Sequence[str]) -> dict[str, int]:
    """The processor on which each process of a run stays: `medium`, `world`, and `nodes` in the order of their turns.

    The medium hands out the turns, so those go first whose processors are not the medium's.
    """
    if not processors:
        return {}
    last, share = len(processors) - 1, len(processors) / max(len(nodes), 1)
    stays = {node: processors[last - int(k * share)] for k, node in enumerate(nodes)}
    return stays | {"medium": processors[0], "world": processors[last]}


def virtual() -> bool:
    """Whether a hypervisor lends the processors."""
    with contextlib.suppress(OSError):
        return " hypervisor" in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    return False


class Vigil:
    """Keeps processors from idling while a run gives signs of life: a process each, which spins at idle priority.

    The kernel runs such a process only when nobody else wants the processor. A context manager.
    """

    def __init__(self, processors: Sequence[int], run: str) -> None:
        context = multiprocessing.get_context("forkserver")
        self._signs: list[int] = []
        self._spinners = []
        for processor in processors:
            read, write = os.pipe()
            os.set_blocking(write, False)
            self._signs.append(write)
            with Connection(read, writable=False) as signs:
                spinner = context.Process(target=_spin, args=(processor, signs, run), daemon=True)
                spinner.start()
            self._spinners.append(spinner)

    @property
    def pids(self) -> list[int]:
        """Of the spinning processes."""
        return [spinner.pid for spinner in self._spinners if spinner.pid is not None]

    def sign(self) -> None:
        """The run goes on: stay awake."""
        for write in self._signs:
            # A full pipe is sign enough.
            with contextlib.suppress(BlockingIOError, BrokenPipeError):
                os.write(write, b".")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        for write in self._signs:
            os.close(write)
        self._signs.clear()
        for spinner in self._spinners:
            spinner.kill()
            spinner.join()


def _spin(processor: int, signs: Connection, run: str) -> None:
    """Ends when the other end of `signs` is closed, as it is when its owner dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    setproctitle(f"vds awake/{processor} {run}")
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    while os.read(signs.fileno(), 4096):
        until_s = time.monotonic() + _AWAKE_S
        while time.monotonic() < until_s:
            pass
