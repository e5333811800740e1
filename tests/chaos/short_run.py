"""A short run of `deploy/run_local.py` as somebody sees it who makes trouble: its processes, its moments, its end."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from deploy.json_file import read_object
from tests import ROOT
from tests.helpers.place import Place

__all__ = ["DURATION_S", "MOMENTS", "SPEED", "ShortRun", "Strike"]

DURATION_S: Final = 12
SPEED: Final = 6
"""Simulated seconds per wall second."""
MOMENTS: Final = (
    "when the first process is there", "before pids.json", "before the first tick", "in the middle", "at the end",
)  # fmt: skip
_COMMAND: Final = (str(ROOT / "deploy" / "run_local.py"),)
_STARTED_S: Final = 90.0
"""Longest wall time for which a moment is waited for."""


@dataclass(frozen=True)
class Strike:
    """A signal that was sent to a process of the run."""

    name: str
    number: signal.Signals
    at_unix_s: float


class ShortRun:
    """One run in a session of its own. Its exit status, streams and files are looked at when it has ended."""

    def __init__(self, seed: int, draw: random.Random, folder: Path) -> None:
        """Prepare.

        Args:
            seed: of the scenario.
            draw: decides what the scenario has, and what the trouble is.
            folder: empty, for this run alone.
        """
        self.draw = draw
        self.out = folder / "disk" / "run"
        self.out.parent.mkdir()
        # Short: a socket's path goes there.
        self.place = Place(folder / "t", self.out)
        self.place.path.mkdir()
        self.robots = draw.randint(3, 5)
        self.strikes: list[Strike] = []
        self.moment = ""
        """When it was struck first."""
        self.acted = False
        """Whether the trouble met the run before its end."""
        self.errors = b""
        """What it printed to standard error."""
        self._seed = seed
        self._process: subprocess.Popen[bytes] | None = None
        self._errors_file = folder / "errors.txt"

    # Its start

    def begin(
        self,
        *arguments: str,
        program: Sequence[str] = _COMMAND,
        stdout: int = subprocess.DEVNULL,
        stderr: int | None = None,
        environment: Mapping[str, str] = {},
        first: Callable[[], object] | None = None,
    ) -> subprocess.Popen[bytes]:
        """Start it: `program` takes the arguments of run_local.py, `first` is what its process does before that."""
        options = {
            "--out": self.out, "--robots": self.robots, "--seed": self._seed, "--duration": DURATION_S,
            "--speed": SPEED, "--radius": self.draw.choice((12, 20)),
        }  # fmt: skip
        words = [str(word) for pair in options.items() for word in pair]
        if self.draw.random() < 0.7:
            words.append("--no-recording")
        with self._errors_file.open("wb") as errors:
            self._process = subprocess.Popen(
                [sys.executable, *program, *words, *arguments], stdin=subprocess.DEVNULL, stdout=stdout,
                stderr=errors if stderr is None else stderr, start_new_session=True, preexec_fn=first,
                env={**os.environ, **self.place.environment, **environment},
            )  # fmt: skip
        return self._process

    @property
    def process(self) -> subprocess.Popen[bytes]:
        assert self._process is not None
        return self._process

    @property
    def over(self) -> bool:
        return self.process.poll() is not None

    # Its moments

    def reach(self, moment: str) -> None:
        """Wait for a moment, and some random time more; returns at once if the run is over before it."""
        self.moment = self.moment or moment
        last = f"robot/{self.robots}"
        seconds = self.draw.uniform(1, DURATION_S - 2)
        there, then_s = {
            "when the first process is there": (lambda: bool(self.processes()), 0.2),
            "before pids.json": (lambda: last in self.processes() or self._told_pids, 0.0),
            "before the first tick": (lambda: self._told_pids, 0.3),
            "in the middle": (lambda: self.simulated_s >= seconds, 0.1),
            "at the end": (lambda: self.simulated_s >= DURATION_S - 1, 0.5),
        }[moment]
        self.wait_until(there)
        self.wait(self.draw.uniform(0.0, then_s))

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Return as soon as the condition holds or the run is over."""
        deadline = time.monotonic() + _STARTED_S
        while not condition() and not self.over and time.monotonic() < deadline:
            time.sleep(0.01)

    def wait(self, seconds: float) -> None:
        """Return after some time, or as soon as the run is over."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)

    @property
    def _pids(self) -> dict[str, int]:
        """What pids.json tells; empty before it is there."""
        try:
            return read_object(self.out / "pids.json")
        except ValueError:
            return {}

    @property
    def _told_pids(self) -> bool:
        return bool(self._pids)

    @property
    def simulated_s(self) -> int:
        """From metrics.csv, which has a row for each second; -1 before the first."""
        try:
            return (self.out / "metrics.csv").read_bytes().count(b"\n") - 2
        except OSError:
            return -1

    def processes(self) -> dict[str, int]:
        """Living processes: by title before pids.json tells of them, and by pids.json before they have a title."""
        found, told = {}, {pid: name for name, pid in self._pids.items()}
        for server in _children(self.process.pid):
            for pid in _children(server):
                with contextlib.suppress(OSError):
                    title = Path(f"/proc/{pid}/cmdline").read_bytes()
                    if title.startswith(b"vds "):
                        found[title.split()[1].decode()] = pid
                    elif title and pid in told:  # without words it is dead, and not yet reaped
                        found[told[pid]] = pid
        return found

    # Trouble

    def strike(self, name: str, number: signal.Signals) -> bool:
        """Send a signal to the launcher or to a process by its name; False if it is not there.

        Before pids.json is there it is waited for, since it is still to come.
        """
        self.wait_until(lambda: self._told_pids or name == "launcher" or name in self.processes())
        pid = self.process.pid if name == "launcher" else self.processes().get(name)
        if pid is None or self.over:
            return False
        at = Strike(name, number, time.time())
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            return False
        self.strikes.append(at)
        self.acted = True
        return True

    @property
    def struck(self) -> set[str]:
        return {strike.name for strike in self.strikes}

    # Its end

    def end(self, within_s: float) -> int | None:
        """Wait for its end; its exit status, or None if it had to be killed."""
        status: int | None = None
        try:
            status = self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        with contextlib.suppress(FileNotFoundError):
            self.errors = self._errors_file.read_bytes()
        return status

    def summary(self) -> dict[str, Any] | None:
        """What the run says of itself; None if it left nothing."""
        try:
            return read_object(self.out / "summary.json")
        except ValueError:
            return None


def _children(pid: int) -> list[int]:
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []
