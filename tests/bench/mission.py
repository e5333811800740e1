"""The emulator's own rows: a mission as a user starts it, in processes or in one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

import deploy
from deploy.processes.collector import collect_rarely
from deploy.scenario import load
from deploy.simulation import Observer, Simulation
from tests.bench.meter import Meter
from tests.bench.row import Row
from world.feed import Snapshot
from world.terms import TICK_S, seconds_of

__all__ = ["Degree", "machine", "mission", "simulated"]

ROOT: Final = Path(deploy.__file__).resolve().parent.parent
"""Root of the program that is measured: the checkout, or `build/compiled`."""


def mission(scenario: str, robots: int, simulated_s: float, *, recording: bool, seed: int = 1) -> Row:
    """Run `deploy/run_local.py` for a while and read its run folder.

    Raises:
        RuntimeError: the run failed.
    """
    with tempfile.TemporaryDirectory(prefix="vds-bench-") as folder:
        out = Path(folder) / "run"
        command = [
            sys.executable, str(ROOT / "deploy/run_local.py"), "--scenario", scenario, "--robots", str(robots),
            "--duration", str(simulated_s), "--seed", str(seed), "--out", str(out), "--quiet",
        ]  # fmt: skip
        command += [] if recording else ["--no-recording"]
        begun = time.time()
        with (
            Meter(lambda: _pids(out)) as meter,
            subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process,
        ):
            _, words = process.communicate()
        if process.returncode:
            raise RuntimeError(f"{' '.join(command)}: {words}")
        summary = json.loads((out / "summary.json").read_text())
    return _row(summary, meter, begun, recording)


def _row(summary: Mapping[str, Any], meter: Meter, begun: float, recording: bool) -> Row:
    first, last = summary["ticked_unix_s"]
    ticks = summary["ticks"]
    return Row(
        what="processes",
        robots=summary["robots"],
        simulated_s=summary["simulated_s"],
        factor=summary["simulated_s"] / (last - first),
        cpu_ms_per_tick=meter.cpu_s(first, last) * 1e3 / ticks,
        p50_ms=summary["tick_ms"]["p50"],
        p99_ms=summary["tick_ms"]["p99"],
        recording=recording,
        start_s=first - begun,
        private_mb=meter.private_mb,
        trace_sha256=summary["trace_sha256"],
    )


def _pids(out: Path) -> dict[str, int]:
    try:
        pids: dict[str, int] = json.loads((out / "pids.json").read_text())
    except (OSError, ValueError):
        return {}
    return pids


def simulated(scenario: str, robots: int, simulated_s: float, *, seed: int = 1) -> Row:
    """Run the same cores in this process, unrecorded."""
    setup = load(scenario, {"robots": robots, "duration_s": simulated_s, "seed": seed})
    degree = Degree(setup.radius_m)
    simulation = Simulation(setup, Observer(snapshot=degree.add))
    collect_rarely()
    ticks_s: list[float] = []
    cpu_s, over = time.process_time(), False
    while not over:
        begun = time.perf_counter()
        _, over = simulation.step()
        ticks_s.append(time.perf_counter() - begun)
    cpu_s = time.process_time() - cpu_s
    low, high = np.percentile(ticks_s, (50, 99)) * 1e3
    return Row(
        what="in-process",
        robots=robots,
        simulated_s=seconds_of(len(ticks_s)),
        factor=len(ticks_s) * TICK_S / sum(ticks_s),
        cpu_ms_per_tick=cpu_s * 1e3 / len(ticks_s),
        p50_ms=round(float(low), 3),
        p99_ms=round(float(high), 3),
        recording=False,
        trace_sha256=str(simulation.medium.final()["trace_sha256"]),
        mean_degree=degree.mean,
    )


class Degree:
    """Number of neighbors within the radius, at every tenth tick."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._links = self._robots = 0

    def add(self, snapshot: Snapshot) -> None:
        if snapshot.tick % 10:
            return
        away = snapshot.xy_m[:, None] - snapshot.xy_m
        self._links += int(((away * away).sum(axis=2) <= self._radius_m**2).sum()) - len(snapshot.nodes)
        self._robots += len(snapshot.nodes)

    @property
    def mean(self) -> float:
        return self._links / max(self._robots, 1)


def machine() -> dict[str, Any]:
    """The machine on which the numbers were measured."""
    return {"cores": os.cpu_count(), "load": os.getloadavg(), "python": sys.version.split()[0]}
