"""Runs one floor: starts its processes, meters them, and makes a row of the results."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from bus.nodes import process_name
from deploy.processes.entry import PRELOAD
from deploy.processes.processors import assigned, shared
from deploy.processes.supervisor import Supervisor
from tests.bench import first_floor, socket_floor, zenoh_floor
from tests.bench.meter import Meter
from tests.bench.pattern import Pattern
from tests.bench.row import Row
from world.terms import TICK_S, seconds_of

__all__ = ["FLOORS", "run_floor"]

Start = Callable[[Pattern, Supervisor, Path], None]

FLOORS: Final[Mapping[str, Start]] = {
    "zenoh": zenoh_floor.start,
    "first design": first_floor.start,
    "zeromq": socket_floor.start_zeromq,
    "unix": socket_floor.start_unix,
}

_END_S: Final = 60.0


def run_floor(name: str, robots: int, wall_s: float) -> Row:
    """Run a floor for `wall_s`.

    Raises:
        RuntimeError: one of its processes failed.
    """
    pattern = Pattern(robots, wall_s)
    with tempfile.TemporaryDirectory(prefix="vds-floor-") as folder:
        result = Path(folder) / "result.json"
        # A floor gets the same processors and modules as a run.
        processors = shared(len(pattern.nodes) + len(("world", "medium")))
        names = [process_name(node) for node in pattern.nodes]
        with Supervisor("floor", Path(folder), PRELOAD, assigned(processors, names)) as supervisor:
            FLOORS[name](pattern, supervisor, result)
            pids = dict(supervisor.pids)
            with Meter(lambda: pids) as meter:
                while supervisor.pids:
                    ends = supervisor.wait(wall_s + _END_S)
                    if not ends or any(end.code for end in ends):
                        tails = "\n".join(supervisor.tail(end.name) for end in ends if end.code)
                        raise RuntimeError(f"floor {name}: {', '.join(map(str, ends)) or 'it hangs'}\n{tails}")
        found = json.loads(result.read_text())
    took_s = found["ended"] - found["began"]
    return Row(
        what=f"floor {name}",
        robots=robots,
        simulated_s=seconds_of(found["ticks"]),
        factor=found["ticks"] * TICK_S / took_s,
        cpu_ms_per_tick=meter.cpu_s(found["began"], found["ended"]) * 1e3 / found["ticks"],
        p50_ms=found["p50_ms"],
        p99_ms=found["p99_ms"],
        private_mb=meter.private_mb,
    )
