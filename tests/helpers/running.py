"""A run of `deploy/run_local.py` under way, started as a user starts it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from bus.session import BusError, Login, Session
from tests import ROOT
from tests.helpers.waiting import alive, wait_until

__all__ = ["LONG", "Running", "assert_readable", "command", "gone"]

SCRIPT = ROOT / "deploy" / "run_local.py"
LONG = ("--duration", 100_000, "--robots", 3, "--radius", 8)
"""Too short a radius to finish, and more time than any test takes."""


def command(*arguments: object) -> list[str]:
    return [sys.executable, str(SCRIPT), *map(str, arguments)]


class Running:
    """One run, in a session and a process group of its own."""

    def __init__(
        self,
        out: Path,
        *arguments: object,
        stdout: int = subprocess.PIPE,
        environment: Mapping[str, str] = {},
        first: Callable[[], object] | None = None,
    ) -> None:
        """Start it.

        Args:
            out: its run folder.
            arguments: of the command.
            stdout: as for `subprocess.Popen`.
            environment: further variables.
            first: what its process does before it becomes the command.
        """
        self.out = out
        self.session: Session | None = None
        self.process = subprocess.Popen(
            command("--out", out, *arguments), stdout=stdout, stderr=subprocess.PIPE, text=True,
            env={**os.environ, **environment}, start_new_session=True, preexec_fn=first,
        )  # fmt: skip

    def pids(self) -> dict[str, int]:
        try:
            return json.loads((self.out / "pids.json").read_text())  # type: ignore[no-any-return]
        except FileNotFoundError:
            return {}

    def status(self) -> dict[str, Any] | None:
        """What the world says; None before it answers."""
        if self.process.poll() is not None:
            _, words = self.process.communicate()
            pytest.fail(f"the run has ended with status {self.process.returncode}: {words}")
        try:
            if self.session is None:
                told = json.loads((self.out / "operator.json").read_text())
                login = Login(told["run"], told["endpoint"], told["user"], told["password"])
                self.session = Session.connect(login, watching=True, timeout_s=10)
            answer = self.session.ask(self.session.keys.control, "status", timeout_s=2)
        except (FileNotFoundError, BusError):
            return None
        return json.loads(answer)  # type: ignore[no-any-return]

    def simulated_s(self) -> float:
        status = self.status()
        return -1.0 if status is None else float(status["tick"]) / 10

    def wait_for(self, seconds: float) -> dict[str, int]:
        """Wait until so much is simulated; returns the pids."""
        wait_until(lambda: self.simulated_s() >= seconds, f"{seconds} s simulated")
        return self.pids()

    def press_ctrl_c(self) -> None:
        """As a terminal does it: to the whole process group."""
        os.killpg(self.process.pid, signal.SIGINT)

    def hang_up(self) -> None:
        """As the kernel does when the terminal is gone: to the whole process group."""
        os.killpg(self.process.pid, signal.SIGHUP)

    def ended(self) -> tuple[int, str, str]:
        """Its exit status, and what it printed, once it has ended."""
        out, errors = self.process.communicate()
        return self.process.returncode, out or "", errors

    def rows(self) -> int:
        """Of metrics.csv, one for each simulated second."""
        try:
            return (self.out / "metrics.csv").read_text().count("\n") - 1
        except FileNotFoundError:
            return -1

    def summary(self) -> dict[str, Any]:
        return json.loads((self.out / "summary.json").read_text())  # type: ignore[no-any-return]


def gone(pids: dict[str, int], but: tuple[str, ...] = ()) -> bool:
    return not any(alive(pid) for name, pid in pids.items() if name not in but)


def assert_readable(recording: Path) -> None:
    """Read it in a process of its own: Rerun must not be loaded into the one that runs the tests."""
    program = (
        "import sys, rerun.chunk as c; print(len({chunk.entity_path for chunk in c.RrdReader(sys.argv[1]).stream()}))"
    )
    told = subprocess.run([sys.executable, "-c", program, str(recording)], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    assert int(told.stdout) > 5
