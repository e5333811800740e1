"""Cost of the recorder: on made-up missions, and on a real one against the same mission without it."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from monitor_station.recording.recorder import Recorder
from tests.bench.row import Row
from tests.helpers.synthetic import Mission, feed
from world.terms import TICK_S

__all__ = ["paired", "recorder_cost"]


def recorder_cost(robots: int, ticks: int) -> dict[str, Any]:
    """Processor time per tick, and size of the file per simulated hour."""
    mission = Mission(robots)
    moments = list(mission.moments(ticks))
    with tempfile.TemporaryDirectory(prefix="vds-bench-") as folder:
        path = Path(folder) / "recording.rrd"
        recorder = Recorder(mission.config, path)
        begun = time.process_time()
        feed(recorder, moments)
        recorder.close()
        spent_s = time.process_time() - begun
        size = path.stat().st_size
    return {
        "robots": robots,
        "ticks": ticks,
        "cpu_ms_per_tick": round(spent_s * 1e3 / ticks, 4),
        "mb_per_simulated_hour": round(size / 1e6 / (ticks * TICK_S) * 3600, 1),
    }


def paired(run: Callable[[bool], Row], pairs: int) -> dict[str, Any]:
    """Recording on against off, in pairs that follow each other, so that the same load disturbs both."""
    factors, costs = [], []
    for number in range(pairs):
        # The order alternates, since the second run may find warm caches.
        first = run(bool(number % 2))
        second = run(not number % 2)
        on, off = (first, second) if number % 2 else (second, first)
        factors.append(on.factor / off.factor)
        costs.append(on.cpu_ms_per_tick / off.cpu_ms_per_tick)
    return {
        "pairs": pairs,
        "factor_on_over_off": round(statistics.median(factors), 3),
        "cpu_on_over_off": round(statistics.median(costs), 3),
    }
