"""`kill -9` of the process that records loses at most two seconds of wall time."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import pytest
import rerun as rr

from deploy.emulation import Emulation
from tests import ROOT
from tests.helpers.recordings import readable

TICKS_PER_S = 100
"""Ten times real time: ticks of a second of wall time."""

LOST_S = 2.0

PACED = f"""
import sys, time
from pathlib import Path
from tests.helpers.synthetic import Mission
from monitor_station.recording.recorder import Recorder
from world.feed import Event
mission = Mission(9)
recorder = Recorder(mission.config, Path(sys.argv[1]))
moments = list(mission.moments(700))
begun = time.monotonic()
for tick, moment in enumerate(moments):
    time.sleep(max(0.0, begun + tick / {TICKS_PER_S} - time.monotonic()))
    recorder.station(moment.view)
    recorder.snapshot(moment.snapshot)
    recorder.event(Event(tick, "link", 1, f"tick {{tick}}"))
    print(tick, flush=True)
"""


def last_ticks(path: Path) -> dict[str, int]:
    """Last tick of each entity; a file without a footer makes the reader warn."""
    last: dict[str, int] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for chunk in rr.chunk.RrdReader(readable(path)).stream():
            batch = chunk.to_record_batch()
            if not chunk.is_static and "tick" in batch.schema.names:
                tick = max(batch.column("tick").to_pylist())
                last[chunk.entity_path] = max(tick, last.get(chunk.entity_path, -1))
    return last


@pytest.mark.processes
def test_a_killed_station_loses_at_most_two_seconds(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    child = subprocess.Popen(
        [sys.executable, "-c", PACED, str(path)], stdout=subprocess.PIPE, text=True,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )  # fmt: skip
    with child:
        assert child.stdout is not None
        tick = -1
        while tick < 630:
            tick = int(child.stdout.readline())
        child.kill()
    last = last_ticks(path)
    for entity in ("/ms/robots", "/truth/robots", "/network/links", "/events/link", "/plots/search"):
        # Some are written every ten ticks only.
        assert last[entity] >= tick - LOST_S * TICKS_PER_S - 10, (
            f"{entity} lost {(tick - last[entity]) / TICKS_PER_S} s"
        )


@pytest.mark.processes
def test_a_run_that_is_held_has_recorded_all(tmp_path: Path) -> None:
    """A held run is recorded up to its last tick, for whoever looks at it then."""
    with Emulation("three_cells", tmp_path, robots=3, record=True) as run:
        run.wait_for(20)
        held = run.command("hold")["tick"]
        path = tmp_path / "recording.rrd"

        def latest(entity: str) -> int:
            return max((tick for name, tick in last_ticks(path).items() if name.startswith(entity)), default=-1)

        for entity, late_ticks in ("/ms/robots", 1), ("/truth/robots", 5), ("/ms/map/", 11):
            run.wait_until(lambda: latest(entity) >= held - late_ticks)  # noqa: B023  # called at once
