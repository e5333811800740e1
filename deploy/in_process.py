"""One run in this process: the same cores, files and view as with real processes, without a bus."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from deploy.failures import Crash, Failures
from deploy.processes.collector import collect_rarely
from deploy.run_folder.summary import shortfall
from deploy.simulation import Observer, Simulation
from world.grid.map_file import save_map

if TYPE_CHECKING:
    from deploy.machine.interrupts import Interrupts
    from deploy.run_folder.writer import RunFolder
    from deploy.scenario import Scenario
    from deploy.screen.view import View
    from world.feed import Event, Snapshot

__all__ = ["run_in_process"]


def run_in_process(
    scenario: Scenario, folder: RunFolder, view: View, *, record: bool, interrupts: Interrupts | None = None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Run to the end, to the first of `interrupts`, or to an exception, as of a policy.

    Returns the summary, and in one entry each why the run fell short.
    """
    begun = time.monotonic()
    recorder = None
    if record:
        from monitor_station.recording.recorder import Recorder

        recorder = Recorder(scenario.recorder_config(folder.path.name), folder.path / "recording.rrd")

    def snapshot(s: Snapshot) -> None:
        folder.snapshot(s)
        view.snapshot(s)
        if recorder is not None:
            recorder.snapshot(s)

    def event(e: Event) -> None:
        folder.event(e)
        view.event(e)
        if recorder is not None:
            recorder.event(e)

    observer = Observer(snapshot, event)
    if recorder is not None:
        observer.view, observer.table = recorder.station, recorder.table
    simulation = Simulation(scenario, observer)
    collect_rarely()
    if interrupts is not None:
        interrupts.pass_to(simulation.world.interrupt)
    failures, finals = Failures(), {}
    try:
        # Snapshots are not kept: a run of days has a million of them.
        while not simulation.step()[1]:
            pass
        finals = simulation.finals()
    except Exception as error:  # such as one of a user's policy: what came before it is kept
        failures.crashed("the run", "the run ended", Crash.of(error))
    finally:
        view.close()
        if recorder is not None:
            with folder.unwritten.noting("recording.rrd"):
                recorder.close()
    if simulation.station is not None:
        with folder.unwritten.noting("map.yaml"):
            save_map(folder.path / "map.yaml", scenario.arena.geometry, simulation.station.merger.cells)
    status = "failed" if failures else None
    summary = folder.finish(finals, time.monotonic() - begun, status=status, failures=failures.lines)
    if (words := shortfall(summary)) is not None and not failures:
        failures.add(words)
    return summary, (*failures.lines, *folder.unwritten.lines)
