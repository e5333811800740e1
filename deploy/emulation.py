"""A run of real processes that a program starts, watches, injects faults into, and asks for verdicts.

The run is `deploy/run_local.py` in a process of its own. It begins held and goes on once its owner listens, so the
owner misses nothing. It ends with its owner, even one that is killed.
`vds/pytest_plugin.py` makes a pytest fixture of it.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

from bus.codec import WireError
from bus.excerpt import shown
from bus.keys import Keys
from bus.nodes import process_name
from bus.session import BusError, Mailbox, Session
from deploy.json_file import read_object
from deploy.machine.scratch import Scratch
from deploy.processes.operator_file import read_operator
from deploy.run_folder.verdicts import verdict_on
from deploy.scenario import load
from world.feed import Event, Snapshot, unpack_feed
from world.terms import STATION, seconds_of

__all__ = ["Emulation", "EmulationError"]

SCRIPT: Final = Path(__file__).resolve().parent / "run_local.py"
_START_S: Final = 90.0
_LEAVE_S: Final = 10.0
_SLICE_S: Final = 0.05


class EmulationError(AssertionError):
    """The run failed, or something did not happen in time. In a test this is a failure."""


class Emulation:
    """One run. A context manager: on leaving, none of its processes is left."""

    def __init__(
        self,
        scenario: str | Path,
        folder: Path,
        *,
        faults: Sequence[str | Mapping[str, Any]] = (),
        record: bool = False,
        **overrides: Any,
    ) -> None:
        """Start a run. When this returns, its first ticks are over, and their snapshots are here.

        Args:
            scenario: name of a scenario, path of a .toml file, or of a map's .yaml file.
            folder: run folder, new or empty.
            faults: as the command line has them ("kill:relay:mid@60") or as a scenario's [[fault]] does.
            record: leave a recording.
            overrides: keys of the scenario, a dot written as two underscores: robots=6, radius_m=10.0,
                deadlines__hang_s=1.0.

        Raises:
            ScenarioError: the scenario can't be run.
            ScratchError: there is no place for temporary files.
            EmulationError: the run did not start.
        """
        values = {key.replace("__", "."): value for key, value in overrides.items()}
        if faults:
            values["fault"] = list(faults)
        self.scenario = load(scenario, values)
        self.folder = folder
        self.events: list[Event] = []
        """All events so far."""
        self.snapshots: list[Snapshot] = []
        """All snapshots so far, one per tick."""
        self.verdicts: list[dict[str, Any]] = []
        """All that `recovery` has returned."""
        self._scratch = Scratch()
        resolved = self._scratch.path / "asked.toml"
        resolved.write_text(self.scenario.to_toml(), encoding="utf-8")
        command = [
            sys.executable, str(SCRIPT), "--scenario", str(resolved), "--out", str(folder), "--hold",
            "--owner", str(os.getpid()),
        ]  # fmt: skip
        self._words = self._scratch.path / "launcher.log"
        with self._words.open("wb") as words:
            self._process = subprocess.Popen(
                command if record else [*command, "--no-recording"],
                stdin=subprocess.DEVNULL, stdout=words, stderr=words, start_new_session=True,
            )  # fmt: skip
        self._mailbox = Mailbox()
        self._session: Session | None = None
        self._summary: dict[str, Any] | None = None
        try:
            self._join()
        except BaseException:
            self.close()
            raise

    # Watching

    @property
    def snapshot(self) -> Snapshot | None:
        """The latest snapshot; None before the first."""
        self._take_in(0.0)
        return self.snapshots[-1] if self.snapshots else None

    @property
    def simulated_s(self) -> float:
        """Simulated time of the latest snapshot."""
        latest = self.snapshot
        return 0.0 if latest is None else seconds_of(latest.tick + 1)

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name: launcher, world, medium, station, robot/1, ..."""
        file = self.folder / "pids.json"
        return read_object(file) if file.exists() else {}

    @property
    def over(self) -> bool:
        """Whether the launcher has ended, and all processes with it."""
        return self._process.poll() is not None

    def wait_until(self, condition: Callable[[], object], timeout_s: float = 60.0) -> None:
        """Return as soon as `condition()` is true; it is evaluated after each message.

        Raises:
            EmulationError: it did not become true within `timeout_s` of wall time, or before the run was over.
        """
        deadline = time.monotonic() + timeout_s
        while not condition():
            over = self.over
            self._take_in(_SLICE_S)
            if condition():
                return
            if over:
                raise EmulationError(f"the run was over before that: {self._tail()}")
            if time.monotonic() > deadline:
                raise EmulationError(
                    f"not within {timeout_s:g} s (at {self.simulated_s:g} s simulated): {self._tail()}"
                )

    def wait_for(self, simulated_s: float, timeout_s: float = 60.0) -> None:
        """Wait until `simulated_s` seconds are simulated."""
        self.wait_until(lambda: self.simulated_s >= simulated_s, timeout_s)

    def recovery(self, of: int | str, timeout_s: float = 60.0) -> dict[str, Any]:
        """The verdict on a fault, as soon as it is final (docs/faults.md lists its fields).

        Args:
            of: whom it struck (4, "station"), or the fault as the command line has it ("kill:relay:mid@60"). Of
                several the last, once it is final.
            timeout_s: of wall time.

        Raises:
            EmulationError: there is no such verdict in time.
            ValueError: `of` is no fault.
        """
        is_of, node = verdict_on(of, self.events), STATION if of == "station" else of
        told: list[dict[str, Any]] = []

        def final() -> bool:
            over = self.over
            told[:] = self.summary["recoveries"] if over else [e.data for e in self.events if e.kind == "recovery"]
            found = sum(map(is_of, told))
            # A later fault on the same node may have been told, and its verdict not yet.
            struck = sum(event.kind == "fault" and event.node == node and bool(event.data) for event in self.events)
            return found > 0 and (over or found >= struck)

        try:
            self.wait_until(final, timeout_s)
        except EmulationError as error:
            names = ", ".join(verdict["fault"] for verdict in told) or "none"
            raise EmulationError(f"no verdict on {shown(of)}; there are: {shown(names, 300)}: {error}") from None
        self.verdicts.append([verdict for verdict in told if is_of(verdict)][-1])
        return self.verdicts[-1]

    @property
    def summary(self) -> dict[str, Any]:
        """summary.json of the run; waits for its end.

        Raises:
            EmulationError: it left none.
        """
        if self._summary is None:
            self.wait_until(lambda: self.over, 600.0)
            self._take_in(0.0)
            try:
                self._summary = read_object(self.folder / "summary.json")
            except ValueError as error:
                raise EmulationError(f"the run left no summary: {error}: {self._tail()}") from None
        return self._summary

    # Acting

    def kill(self, who: int | str) -> None:
        """`kill -9` by hand: a robot's id, or the name of a process (station, world, medium, launcher)."""
        self._signal(who, signal.SIGKILL)

    def pause(self, who: int | str) -> None:
        """`kill -STOP` by hand."""
        self._signal(who, signal.SIGSTOP)

    def resume(self, who: int | str) -> None:
        """`kill -CONT` by hand."""
        self._signal(who, signal.SIGCONT)

    def command(self, words: str) -> dict[str, Any]:
        """Ask what the command `ctl` asks, such as "status", "hold", "go" or "fault jam:1,2@0+5".

        Raises:
            EmulationError: the run refused, or does not answer.
        """
        try:
            assert self._session is not None
            told: dict[str, Any] = json.loads(self._session.ask(self._session.keys.control, words, timeout_s=10.0))
        except BusError as error:
            raise EmulationError(f"'{shown(words)}': {error}") from error
        if "error" in told:
            raise EmulationError(f"'{shown(words)}': {shown(told['error'], 300)}")
        return told

    def stop(self) -> dict[str, Any]:
        """End the run now, in good order; returns its summary."""
        with contextlib.suppress(EmulationError):
            self.command("interrupt")
        return self.summary

    def close(self) -> None:
        """End all processes of the run that are left."""
        if self._session is not None:
            self._session.close()
            self._session = None
        self._process.terminate()
        try:
            self._process.wait(_LEAVE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        with contextlib.suppress(OSError):  # the run did not begin, or close was called before
            shutil.copyfile(self._words, self.folder / "logs" / self._words.name)
        self._scratch.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Inside

    def _join(self) -> None:
        deadline = time.monotonic() + _START_S
        while self._session is None:
            if self.over:
                raise EmulationError(f"the run did not start: {self._tail()}")
            if time.monotonic() > deadline:
                raise EmulationError(f"no run within {_START_S:g} s: {self._tail()}")
            with contextlib.suppress(ValueError, BusError):
                self._session = Session.connect(read_operator(self.folder), watching=True)
                continue
            time.sleep(_SLICE_S)
        keys = self._session.keys
        self._session.subscribe(self._mailbox, keys.feed, keys.event)
        self.wait_until(self._answers, _START_S)
        self.command("go")
        self.wait_until(lambda: self.snapshots, _START_S)

    def _answers(self) -> bool:
        """Whether all processes have started, so that the world is held and answers."""
        try:
            return bool(self.pids) and "tick" in self.command("status")
        except EmulationError:
            return False

    def _signal(self, who: int | str, number: signal.Signals) -> None:
        name = process_name(who) if isinstance(who, int) else who
        if name not in self.pids:
            raise EmulationError(f"there is no {shown(name)} in this run: {shown(', '.join(self.pids), 300)}")
        os.kill(self.pids[name], number)

    def _take_in(self, timeout_s: float) -> None:
        while (message := self._mailbox.get(timeout_s)) is not None:
            timeout_s = 0.0
            key, payload = message
            if payload is None:
                continue
            with contextlib.suppress(WireError):
                if Keys.kind_of(key)[0] == "feed":
                    self.snapshots += unpack_feed(payload)
                else:
                    self.events.append(Event.decode(payload))

    def _tail(self) -> str:
        if not self._words.exists():
            return "closed"
        lines = self._words.read_text(encoding="utf-8").splitlines()
        return " | ".join(lines[-5:]) or "it said nothing"
