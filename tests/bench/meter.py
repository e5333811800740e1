"""Cost of processes, read from /proc while they run: processor time, and memory that no other process shares."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Self

import numpy as np

__all__ = ["Meter", "private_mb"]

_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_EVERY_S: Final = 0.1


class Meter:
    """Samples the processor time of a changing set of processes; a context manager."""

    def __init__(self, pids: Callable[[], Mapping[str, int]]) -> None:
        """Begin to sample.

        Args:
            pids: the processes to watch by name, asked for before each sample.
        """
        self._pids = pids
        self._at: list[float] = []
        self._total_s: list[float] = []
        self._spent_s: dict[int, float] = {}
        self._before_s: dict[int, float] = {}
        self.private_mb: dict[str, float] = {}
        """Highest unique set size of each process."""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="meter", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def cpu_s(self, begin: float, end: float) -> float:
        """Processor time that all processes together took between two moments of `time.time()`."""
        if len(self._at) < 2:
            return float("nan")
        first, last = np.interp((begin, end), self._at, self._total_s)
        return float(last - first)

    def _run(self) -> None:
        number = 0
        while not self._over.wait(_EVERY_S):
            for name, pid in self._pids().items():
                spent = _cpu_s(pid)
                if spent is not None:
                    # Time before the first sample of a process is start-up, and does not belong to the ticks.
                    self._before_s.setdefault(pid, spent)
                    self._spent_s[pid] = spent - self._before_s[pid]
                if number % 10 == 9 and (held := private_mb(pid)) is not None:
                    self.private_mb[name] = max(self.private_mb.get(name, 0.0), held)
            self._at.append(time.time())
            self._total_s.append(sum(self._spent_s.values()))
            number += 1


def _cpu_s(pid: int) -> float | None:
    """User and system time of a process (proc(5), stat); None if it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def private_mb(pid: int) -> float | None:
    """Unique set size of a process in MB (proc(5), smaps_rollup); None if it is gone."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return None
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) * 1024 / 1e6
