"""Faults on real processes, and the verdicts on them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.emulation import Emulation, EmulationError
from deploy.run_folder.verdicts import settle
from deploy.scenario import load
from deploy.simulation import Result, Simulation
from tests import ROOT
from tests.helpers.waiting import alive, wait_until

pytestmark = pytest.mark.processes

Start = Callable[..., Emulation]
CORRIDOR = ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml"
"""At 24 s its robots stand in a chain of three hops and more."""

BOUND_S = 60.0
"""Every orphan has a route again within this time."""


def simulated(*faults: str) -> Result:
    return Simulation(load(CORRIDOR, {"fault": list(faults)})).run()


def verdicts_of(result: Result) -> list[dict[str, Any]]:
    world, station = result.finals["world"], result.finals["station"]
    return settle(world["recoveries"], world["acknowledged"], station["complete"])


def played(start: Start, *faults: str) -> list[dict[str, Any]]:
    """Run with scheduled faults: twice in real processes, once in this one, all the same; returns the verdicts."""
    alone = simulated(*faults)
    first, second = (start(CORRIDOR, faults=faults) for _ in range(2))
    for run in (first, second):
        summary = run.summary
        assert summary["failures"] == []
        assert summary["wall_clock_faults"] == 0
        assert summary["trace_sha256"] == alone.trace_sha256
        assert summary["recoveries"] == verdicts_of(alone)
        assert summary["faults"] == alone.finals["world"]["faults"]
    verdicts: list[dict[str, Any]] = first.summary["recoveries"]
    assert len(verdicts) == len(faults)
    for verdict in verdicts:
        assert verdict["scan_reports"]["lost"] == 0
    told = [event.data for event in first.events if event.kind == "recovery"]
    assert told == [{k: v for k, v in verdict.items() if k != "scan_reports"} for verdict in verdicts]
    return verdicts


def healed(verdict: dict[str, Any], *, least: int = 1) -> bool:
    """At least so many robots were cut off, noticed it, and all that lived on had a route again within the bound."""
    return (
        verdict["recovered"] is True
        and len(verdict["orphaned"]) >= least
        and 0 <= verdict["detected_s"] <= verdict["recovered_s"] <= BOUND_S
        and 0 < verdict["robot_seconds_without_path"] <= verdict["recovered_s"] * len(verdict["orphaned"]) + 1e-6
    )


def test_the_radio_changes_alike_in_one_process_and_in_many(emulation: Start) -> None:
    change = [{"at_s": 3.0, "set": {"radio.loss": 0.3, "radio.burst_share": 0.2}}]
    alone = Simulation(load(CORRIDOR, {"duration_s": 6.0, "change": change})).run()
    run = emulation(CORRIDOR, duration_s=6.0, change=change)
    assert run.summary["trace_sha256"] == alone.trace_sha256
    assert alone.trace_sha256 != Simulation(load(CORRIDOR, {"duration_s": 6.0})).run().trace_sha256


def test_a_relay_in_the_middle_is_killed(emulation: Start) -> None:
    (verdict,) = played(emulation, "kill:relay:mid@24")
    assert healed(verdict)
    assert verdict["detected_s"] <= 1.3, "the neighbor timeout is 10 ticks"


def test_the_farthest_search_robot_is_killed(emulation: Start) -> None:
    (verdict,) = played(emulation, "kill:sr:far@24")
    assert verdict["recovered"] == "not affected"
    assert verdict["orphaned"] == []
    assert verdict["robot_seconds_without_path"] == 0


def test_two_relays_are_killed_in_the_same_tick(emulation: Start) -> None:
    first, second = played(emulation, "kill:relay:first@24", "kill:relay:mid@24")
    assert first["robot"] != second["robot"]
    assert healed(first, least=2)
    assert {o["robot"]: o["departed"] for o in first["orphans"]}[second["robot"]], "one orphan is the other's victim"


def test_a_relay_is_paused_for_five_seconds(emulation: Start) -> None:
    (verdict,) = played(emulation, "pause:relay:mid@24+5")
    assert healed(verdict)
    assert verdict["kind"] == "pause"


def test_a_relay_is_restarted(emulation: Start) -> None:
    (verdict,) = played(emulation, "restart:relay:mid@24+3")
    assert healed(verdict)
    assert verdict["kind"] == "restart"


def test_the_first_hop_is_jammed(emulation: Start) -> None:
    """Nobody in the safety zone hears anything, the MS included, so all routes over it break."""
    (verdict,) = played(emulation, "jam:0,0,8,8@24+4")
    assert verdict["robot"] is None
    assert verdict["recovered"] is True
    assert verdict["recovered_s"] >= 4.0


def test_the_station_is_restarted(emulation: Start) -> None:
    (verdict,) = played(emulation, "restart:station@20+3")
    assert healed(verdict, least=5)
    assert verdict["recovered_s"] > 3.0 + 1.1, "it keeps silent for 11 ticks after its return"
    assert verdict["scan_reports"]["delayed"] > 0


def test_of_two_faults_in_one_tick_each_has_its_own_verdict(emulation: Start) -> None:
    run = emulation(CORRIDOR, faults=["kill:2@3", "kill:3@3"], duration_s=6.0)
    assert [run.recovery(of=f"kill:{robot}@3")["robot"] for robot in (3, 2)] == [3, 2]
    with pytest.raises(EmulationError, match="no verdict on kill:4@3; there are: kill:2@3, kill:3@3"):
        run.recovery(of="kill:4@3")


# By hand


def present(run: Emulation, robot: int) -> bool:
    return run.snapshot is not None and bool(run.snapshot.present[robot - 1])


def test_a_station_that_is_killed_by_hand_goes_on_with_all_that_it_had(emulation: Start, tmp_path: Path) -> None:
    run = emulation(CORRIDOR, record=True, speed=8.0)
    run.wait_for(15)
    before = run.pids["station"]
    assert run.snapshot is not None
    merged = run.snapshot.merged
    run.kill("station")
    verdict = run.recovery(of="station")
    assert healed(verdict, least=6)
    assert run.pids["station"] != before
    summary = run.summary
    assert (summary["status"], summary["failures"]) == ("time_limit", [])
    (fault,) = summary["faults"]
    assert (fault["verb"], fault["target"]) == ("restart", "station")
    assert summary["scan_reports"]["lost"] == 0
    assert summary["scan_reports"]["merged"] > merged > 0
    reports = summary["scan_reports"]
    assert reports["merged"] <= reports["made"] <= reports["merged"] + reports["buffered"]
    progress = [sum(s.search_rate) for s in run.snapshots]
    assert progress == sorted(progress), "nothing is searched twice"
    assert_one_recording(run.folder)

    again = tmp_path / "again"
    replay = [sys.executable, str(ROOT / "deploy" / "run_local.py"), "--in-process", "--no-recording", "--quiet"]
    subprocess.run([*replay, "--replay-faults", run.folder, "--out", again], check=True)
    replayed = json.loads((again / "summary.json").read_text())
    assert replayed["trace_sha256"] == summary["trace_sha256"]
    assert replayed["wall_clock_faults"] == 0


def test_faults_by_hand_and_by_control_are_replayed(emulation: Start, tmp_path: Path) -> None:
    run = emulation(CORRIDOR, speed=8.0)
    run.wait_for(12)
    run.kill(3)
    run.wait_until(lambda: not present(run, 3))
    run.command("fault restart:2@0+2")
    run.wait_for(16)
    run.command("fault jam:1,5@0+3")
    run.command("fault pause:4@0+2")
    run.wait_for(20)
    run.pause(6)
    run.wait_until(lambda: not present(run, 6))
    run.wait_for(run.simulated_s + 2)
    run.resume(6)
    summary = run.summary
    assert [fault["verb"] for fault in summary["faults"]] == ["kill", "restart", "jam", "pause", "pause"]
    assert summary["wall_clock_faults"] == 5

    again = tmp_path / "again"
    replay = [sys.executable, str(ROOT / "deploy" / "run_local.py"), "--in-process", "--no-recording", "--quiet"]
    replay += ["--replay-faults", str(run.folder), "--compare", str(run.folder), "--out", str(again)]
    subprocess.run(replay, check=True)
    replayed = json.loads((again / "summary.json").read_text())
    assert replayed["trace_sha256"] == summary["trace_sha256"]
    assert replayed["faults"] == summary["faults"]
    assert replayed["recoveries"] == [v | {"search_time_lost_s": None} for v in summary["recoveries"]]
    assert replayed["search_time_lost_s"] == {"A": None, "all": None}


@pytest.mark.parametrize("who", ["medium", "world"])
def test_stopping_medium_or_world_for_three_seconds_leaves_no_robot_out(emulation: Start, who: str) -> None:
    run = emulation(CORRIDOR)
    run.wait_for(5)
    run.pause(who)
    with pytest.raises(EmulationError, match="not within 3 s"):
        run.wait_until(lambda: run.over, 3.0)
    run.resume(who)
    summary = run.summary
    assert (summary["status"], summary["faults"], summary["failures"]) == ("time_limit", [], [])
    assert all(s.present.all() for s in run.snapshots)
    assert summary["trace_sha256"] == simulated().trace_sha256


@pytest.mark.parametrize("who", ["launcher", "medium", "world"])
def test_whoever_is_killed_everybody_says_a_last_word(emulation: Start, who: str) -> None:
    run = emulation(CORRIDOR)
    run.wait_for(3)
    pids = run.pids
    run.kill(who)
    wait_until(lambda: not any(alive(pid) for name, pid in pids.items() if name != "launcher"), "all are gone")
    words = ["gone: this process ends"]
    if who == "launcher":
        # The world hears of that, too, and may have ended the run before a robot has run.
        words = ["the launcher is gone: this process ends", "the run is over: this process ends"]
    for name in set(pids) - {"launcher", who, "world", "medium"}:
        lines = (run.folder / "logs" / f"{name.replace('/', '-')}.log").read_text().splitlines()
        assert any(word in line for word in words for line in lines[-2:]), (name, lines)


def assert_one_recording(folder: Path) -> None:
    """Both parts belong to the same recording, which Rerun merges into one with the map of both."""
    parts = sorted(folder.glob("recording*.rrd"))
    assert {part.name for part in parts} == {"recording.rrd", "recording-2.rrd"}
    merged = folder / "merged.rrd"
    rerun = Path(sys.executable).with_name("rerun")
    with merged.open("wb") as file:
        subprocess.run([rerun, "rrd", "merge", *parts], stdout=file, stderr=subprocess.DEVNULL, check=True)
    program = (
        "import sys, rerun.chunk as c\n"
        "r = c.RrdReader(sys.argv[1])\n"
        "print(len(r.recordings()))\n"
        "ticks = [t for k in r.stream() if str(k.entity_path) == '/truth/robots' and not k.is_static\n"
        "         for t in k.to_record_batch().column('tick').to_pylist()]\n"
        "print(min(ticks), max(ticks))"
    )
    asked = [sys.executable, "-c", program, str(merged)]
    told = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    recordings, ticks = told.stdout.splitlines()
    assert recordings == "1"
    first, last = map(int, ticks.split())
    assert first == 0
    assert last > 300
