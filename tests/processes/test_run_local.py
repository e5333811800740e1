"""`deploy/run_local.py` for a user: bad input, a run, Ctrl-C, and processes that are killed."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from bus.session import free_endpoint, port_of
from tests import ROOT
from tests.helpers.policies import policies
from tests.helpers.running import LONG, Running, assert_readable, command, gone
from tests.helpers.waiting import alive, wait_until

__all__ = ["policies"]

CTL = ROOT / "deploy" / "ctl.py"
POOR_RADIO = (
    "--fault", "pause:2@4+2", "--fault", "restart:3@8+2", "--set", "radio.model=log_distance",
    "--set", "radio.shadowing_db=3.0", "--set", "radio.shadowing_correlation_m=5.0", "--set", "radio.fading=rayleigh",
    "--set", "radio.burst_share=0.1", "--set", "radio.bandwidth_bytes_s=5000", "--set", "radio.channel_bytes_s=20000",
)  # fmt: skip
"""Everything that is off by default."""
BODIES = ("--policy", "sortie", "--set", "body_radius_m=0.25", "--fault", "kill:2@8")


def run(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), capture_output=True, text=True, cwd=cwd, check=False)


def no_image(tmp_path: Path) -> Path:
    (tmp_path / "map.pgm").write_text("this is no image")
    return map_file(tmp_path)


def map_file(tmp_path: Path) -> Path:
    path = tmp_path / "map.yaml"
    path.write_text(
        "image: map.pgm\nresolution: 0.5\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


def station_in_wall(tmp_path: Path) -> Path:
    path = tmp_path / "in_wall.toml"
    text = (ROOT / "deploy" / "scenarios" / "three_cells.toml").read_text()
    changed, count = re.subn(r"(?m)^(position_m\s*=\s*).*$", r"\g<1>[1.0, 1.0]", text)
    assert count == 1
    path.write_text(changed)
    return path


BAD: dict[str, tuple[Callable[[Path], list[object]], str]] = {
    "no robots": (lambda _: ["--robots", 0], "robots"),
    "negative robots": (lambda _: ["--robots", -3], "robots"),
    "robots no number": (lambda _: ["--robots", "many"], "--robots"),
    "unknown scenario": (lambda _: ["--scenario", "three_cell"], "three_cells"),
    "unknown key": (lambda _: ["--set", "radius=25"], "radius_m"),
    "radius nan": (lambda _: ["--radius", "nan"], "radius"),
    "bad speed": (lambda _: ["--speed", "fast"], "speed"),
    "bad fault": (lambda _: ["--fault", "kil:4@60"], "kil"),
    "fault without a robot": (lambda _: ["--robots", 3, "--fault", "kill:4@60"], "4"),
    "an external robot that there is not": (lambda _: ["--robots", 3, "--external", 4], "4"),
    "an external robot in one process": (lambda _: ["--external", 3, "--in-process"], "robot 3 is external"),
    "a fault to an external robot": (lambda _: ["--external", 3, "--fault", "pause:3@5+1"], "robot 3: it is external"),
    "missing map": (lambda tmp: ["--scenario", tmp / "none.yaml"], "none.yaml"),
    "missing image": (lambda tmp: ["--scenario", map_file(tmp)], "map.pgm"),
    "no image": (lambda tmp: ["--scenario", no_image(tmp)], "map.pgm"),
    "station in a wall": (lambda tmp: ["--scenario", station_in_wall(tmp)], "wall"),
    "folder under a file": (lambda _: ["--out", "/dev/null/run"], "/dev/null/run"),
    "folder that can't be made": (lambda _: ["--out", "/proc/run"], "/proc/run"),
    "port out of range": (lambda _: ["--port", 70000], "70000"),
    "unknown option": (lambda _: ["--robot-count", 3], "--robot-count"),
    "replay of no run": (lambda tmp: ["--replay-faults", tmp / "none"], "none/summary.json"),
    "comparison with no run": (lambda tmp: ["--compare", tmp / "none"], "none/summary.json"),
    "unknown policy": (lambda _: ["--policy", "vdss"], "vdss"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_clear_line_and_status_2(name: str, tmp_path: Path) -> None:
    arguments, word = BAD[name]
    out = [] if "--out" in arguments(tmp_path) else ["--out", tmp_path / "run"]
    ended = run(*out, *arguments(tmp_path))
    assert ended.returncode == 2, ended.stderr
    assert word in ended.stderr
    assert ended.stderr.count("\n") == 1, ended.stderr
    assert ended.stdout == ""
    assert not (tmp_path / "run").exists(), "nothing is left behind"


def test_a_port_in_use_is_named(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        ended = run("--port", port, "--out", tmp_path / "run")
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert str(port) in ended.stderr


def test_the_router_is_a_socket_or_a_port_and_nothing_of_it_stays(tmp_path: Path) -> None:
    short = Path(tempfile.mkdtemp(prefix="vds-test-"))
    digests = set()
    for name, port in ("socket", []), ("port", ["--port", port_of(free_endpoint())]):
        out = tmp_path / name
        ended = subprocess.run(
            command("--robots", 2, "--duration", 3, "--out", out, "-q", *port),
            env=dict(os.environ, TMPDIR=str(short)), check=False,
        )  # fmt: skip
        assert ended.returncode == 0
        assert not list(short.iterdir())
        digests.add(json.loads((out / "summary.json").read_text())["trace_sha256"])
    short.rmdir()
    assert len(digests) == 1


@pytest.mark.parametrize("script", [["run_local.py", "--robots", "9"], ["ctl.py", "status"], ["study.py", "fig6"]])
def test_without_its_dependencies_it_says_how_to_get_them(script: list[str], tmp_path: Path) -> None:
    for package in ("bus", "deploy"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    bare = [sys.executable, "-S", "-I", str(tmp_path / "deploy" / script[0]), *script[1:]]
    ended = subprocess.run(bare, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "make setup" in ended.stderr
    assert f".venv/bin/python deploy/{script[0]}" in ended.stderr


@pytest.mark.processes
def test_a_short_run_ends_at_its_time_limit_and_leaves_everything(start: Callable[..., Running]) -> None:
    running = start("--robots", 3, "--duration", 20)
    status, out, errors = running.ended()
    assert (status, errors) == (0, "")
    summary = running.summary()
    assert (summary["status"], summary["ticks"], summary["robots"]) == ("time_limit", 200, 3)
    assert summary["wall_clock_faults"] == 0
    assert re.fullmatch("[0-9a-f]{64}", summary["trace_sha256"])
    assert len((running.out / "metrics.csv").read_text().splitlines()) == 21
    left = {path.name for path in running.out.iterdir()}
    assert {"recording.rrd", "scenario.toml", "map.yaml", "map.pgm", "events.jsonl", "pids.json", "logs"} <= left
    assert "operator.json" not in left
    assert {path.name for path in (running.out / "logs").iterdir()} == {
        "world.log", "medium.log", "station.log", "robot-1.log", "robot-2.log", "robot-3.log",
    }  # fmt: skip
    assert "time_limit" in out
    assert gone(running.pids())


@pytest.mark.processes
def test_of_two_launchers_with_one_folder_one_runs(tmp_path: Path) -> None:
    pair = [Running(tmp_path / "run", "--robots", 2, "--duration", 5, "-q") for _ in range(2)]
    ends = sorted(running.ended() for running in pair)
    assert [status for status, _, _ in ends] == [0, 2]
    assert ends[0][2] == ""
    assert ends[1][2].count("\n") == 1
    assert "run is under way there" in ends[1][2] or "holds an earlier run" in ends[1][2]
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "time_limit"


@pytest.mark.processes
def test_a_held_run_is_interrupted_as_any(start: Callable[..., Running]) -> None:
    running = start(*LONG, "--hold")
    wait_until(lambda: running.status() is not None, "the world answers")
    running.process.terminate()
    assert running.ended()[::2] == (0, "")
    assert running.summary()["status"] == "interrupted"


@pytest.mark.processes
def test_a_launcher_that_is_late_still_hears_every_last_word(start: Callable[..., Running]) -> None:
    running = start("--robots", 3, "--duration", 10, "--speed", 10)
    pids = running.wait_for(1)
    os.kill(running.process.pid, signal.SIGSTOP)
    wait_until(lambda: gone(pids, but=("launcher", "medium")), "only launcher and medium are left")
    medium = os.pidfd_open(pids["medium"])
    assert select.select([medium], [], [], 1.5)[0] == [], "the medium hosts the router: it stays until all is heard"
    os.close(medium)
    os.kill(running.process.pid, signal.SIGCONT)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["trace_sha256"] is not None


@pytest.mark.processes
@pytest.mark.parametrize(
    "options", [(), ("--policy", "scout", "--radius", 8, "--set", "radio.model=disk_los"), POOR_RADIO, BODIES]
)
def test_the_same_run_in_one_process_has_the_same_digest(
    start: Callable[..., Running], options: tuple[object, ...]
) -> None:
    of_all = ("--robots", 3, "--duration", 20, "--no-recording", *options)
    many, one = (start(*of_all, *more) for more in ([], ["--in-process"]))
    assert many.ended()[0] == one.ended()[0] == 0
    told = (
        "trace_sha256",
        "status",
        "ticks",
        "search_rate",
        "connected_fraction",
        "scan_reports",
        "frames",
        "blocked_moves",
    )
    for key in told:
        assert many.summary()[key] == one.summary()[key], key
    assert not (many.out / "recording.rrd").exists()


@pytest.mark.processes
@pytest.mark.parametrize("end", [Running.press_ctrl_c, lambda running: running.process.terminate(), Running.hang_up])
def test_an_interrupted_run_keeps_what_it_has(start: Callable[..., Running], end: Callable[[Running], None]) -> None:
    running = start(*LONG)
    pids = running.wait_for(5)
    end(running)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert gone(pids)
    assert running.summary()["status"] == "interrupted"
    assert running.summary()["simulated_s"] >= 5
    assert_readable(running.out / "recording.rrd")


@pytest.mark.processes
def test_an_interrupt_while_it_starts_leaves_no_process(start: Callable[..., Running]) -> None:
    running = start(*LONG)
    wait_until(lambda: bool(running.pids()), "the processes are started")
    running.press_ctrl_c()
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    assert running.summary()["status"] == "interrupted"
    assert gone(running.pids())


@pytest.mark.processes
def test_a_killed_and_a_hung_agent_cost_the_run_nothing_but_themselves(start: Callable[..., Running]) -> None:
    running = start("--robots", 4, "--duration", 60, "--speed", 20)
    pids = running.wait_for(3)
    os.kill(pids["robot/2"], signal.SIGKILL)
    os.kill(pids["robot/3"], signal.SIGSTOP)
    status, _, errors = running.ended()
    assert (status, errors) == (0, "")
    summary = running.summary()
    assert (summary["status"], summary["ticks"]) == ("time_limit", 600)
    assert summary["wall_clock_faults"] == 2
    assert {fault["target"] for fault in summary["faults"]} == {"2", "3"}
    assert {2, 3} <= {json.loads(line)["node"] for line in events_of(running.out, "fault")}
    assert gone(pids)


@pytest.mark.processes
def test_an_agent_that_raises_is_named_with_its_last_words_while_the_run_goes_on(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "tests.helpers.failing_agent", str(tmp_path)],
        capture_output=True, text=True, check=False, env=dict(os.environ, PYTHONPATH=str(ROOT)),
    )  # fmt: skip
    assert ended.returncode == 1, ended.stderr
    assert re.search(r"robot/2 \(pid \d+\) exited with status 1", ended.stdout)
    assert "ArithmeticError: a robot that can't go on" in ended.stdout
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["status"], summary["ticks"], len(summary["failures"])) == ("time_limit", 100, 1)


@pytest.mark.processes
def test_robots_that_all_raise_in_the_same_way_are_told_once(start: Callable[..., Running], policies: Path) -> None:
    environment = {"PYTHONPATH": str(policies)}
    running = start("--robots", 5, "--policy", "climbing:Climbs", "--no-recording", environment=environment)
    status, _, errors = running.ended()
    assert status == 1
    assert errors.count("Traceback") == 1
    assert errors.count("has had enough") == 3, "in the first line, and twice in the traceback"
    assert re.search(
        r"robot/\d \(pid \d+\) exited with status 1: ArithmeticError: .*climbing\.py, line 8\)$", errors, re.MULTILINE
    )
    assert re.search(
        r"^    4 more failed in the same way: robot/\d, robot/\d, robot/\d, robot/\d$", errors, re.MULTILINE
    )
    assert len(errors.splitlines()) < 10
    assert (running.summary()["status"], len(running.summary()["failures"])) == ("no_robots", 1)


@pytest.mark.processes
@pytest.mark.parametrize("victim", ["world", "medium"])
def test_without_world_or_medium_the_run_has_failed(start: Callable[..., Running], victim: str) -> None:
    running = start(*LONG)
    pids = running.wait_for(3)
    os.kill(pids[victim], signal.SIGKILL)
    wait_until(lambda: gone(pids, but=("launcher",)), "everybody else is gone")
    status, _, errors = running.ended()
    assert status == 1
    assert f"{victim} (pid {pids[victim]}) ended by SIGKILL" in errors
    assert running.summary()["status"] == "failed"
    assert_readable(running.out / "recording.rrd")


@pytest.mark.processes
def test_a_killed_launcher_leaves_nobody_behind_and_a_readable_recording(start: Callable[..., Running]) -> None:
    running = start(*LONG)
    pids = running.wait_for(3)
    os.kill(pids["robot/1"], signal.SIGSTOP)
    running.process.kill()
    running.process.communicate()
    wait_until(lambda: gone(pids), "everybody is gone")
    assert_readable(running.out / "recording.rrd")


@pytest.mark.processes
def test_a_hand_on_the_run(start: Callable[..., Running]) -> None:
    """hold, step, kill and speed by ctl.py."""

    def ctl(*words: str) -> subprocess.CompletedProcess[str]:
        asked = [sys.executable, str(CTL), "--run", str(running.out), *words]
        return subprocess.run(asked, capture_output=True, text=True, check=False)

    running = start(*LONG, "--speed", 20)
    pids = running.wait_for(1)
    assert (running.out / "operator.json").stat().st_mode & 0o077 == 0
    assert ctl("hold").returncode == 0
    held = running.simulated_s()
    assert running.simulated_s() == held
    assert ctl("step").returncode == 0
    wait_until(lambda: running.simulated_s() == pytest.approx(held + 0.1), "one tick")
    assert ctl("kill", "99").returncode == 1
    assert "kill 2 acts at the next tick" in ctl("kill", "2").stdout
    assert ctl("speed", "max").returncode == 0
    wait_until(lambda: not alive(pids["robot/2"]), "robot 2 is dead")
    running.wait_for(held + 20)
    assert re.fullmatch(r"[0-9.]+ s: paused robot 3 for 1 s, run run-0\n", ctl("pause", "3", "1").stdout)
    again = ctl("kill", "2")
    assert (again.returncode, "is away already, nothing done" in again.stdout) == (1, True)
    assert json.loads(ctl("--json", "status").stdout)["held"] is False
    assert ctl("interrupt").returncode == 0
    assert running.ended()[0] == 0
    assert [fault["verb"] for fault in running.summary()["faults"]] == ["kill", "pause"]


def events_of(out: Path, kind: str) -> list[str]:
    return [line for line in (out / "events.jsonl").read_text().splitlines() if json.loads(line)["kind"] == kind]
