"""`deploy/run_local.py --live`: a viewer that follows a run, and one that stalls and delays no process."""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from deploy.screen.live_viewer import has_display, viewer_command
from tests import ROOT
from tests.helpers.stalled_viewer import StalledViewer
from tests.helpers.waiting import wait_until

SHORT = ["--robots", "3", "--duration", "30"]
"""Simulated seconds: long enough to be joined, short enough to be repeated."""


@pytest.mark.parametrize(
    ("environment", "platform", "window"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({}, "darwin", True),
    ],
)
def test_a_window_needs_a_display(environment: dict[str, str], platform: str, window: bool) -> None:
    assert has_display(environment, platform) is window


@pytest.mark.parametrize("web_port", [None, 9090])
def test_viewers_listen_on_loopback_only(web_port: int | None) -> None:
    command = viewer_command("rerun", 9876, web_port)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == "rerun+http://127.0.0.1:9876/proxy"


@pytest.mark.parametrize("other", ["--in-process", "--no-recording"])
def test_live_without_a_recording_is_refused(other: str, tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "deploy" / "run_local.py"), "--live", other, "--out", str(tmp_path / "run")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "--live" in ended.stderr
    assert not (tmp_path / "run").exists()


@contextlib.contextmanager
def live_run(out: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A run of real processes with a viewer, on a machine without a display."""
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, str(ROOT / "deploy" / "run_local.py"), *SHORT, "--live", "--out", str(out), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as run:
        try:
            yield run
        finally:
            run.kill()


def address(run: subprocess.Popen[str]) -> str:
    """Where the run says that it can be watched."""
    assert run.stdout is not None
    for line in run.stdout:
        if match := re.search(r"watch it: (http://127\.0\.0\.1:\d+/\S+)", line):
            return match[1]
    pytest.fail("the run ended without an address")


def served_port(page: str) -> int:
    """Port of the recording, from the address of the page that shows it."""
    source = parse_qs(urlsplit(page).query)["url"][0]
    assert source.startswith("rerun+http://127.0.0.1:")
    return int(source.split(":")[2].split("/")[0])


@pytest.mark.processes
def test_the_page_is_served_while_the_run_lasts(tmp_path: Path) -> None:
    with live_run(tmp_path / "run", "--speed", "10") as run:
        page = address(run)
        port = urlsplit(page).port
        wait_until(lambda: _fetched(f"http://127.0.0.1:{port}/"), "the viewer's page")
        run.communicate()
        assert run.returncode == 0
    assert not _fetched(f"http://127.0.0.1:{port}/"), "nothing of the run is left"


@pytest.mark.processes
def test_a_recording_is_opened_as_a_page_without_a_display(tmp_path: Path) -> None:
    out = tmp_path / "run"
    short = ["--in-process", "-q", "--robots", "1", "--duration", "1", "--out", str(out)]
    subprocess.run([sys.executable, str(ROOT / "deploy" / "run_local.py"), *short], check=True)
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "vds", "open", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT) as viewer:
        try:
            page = address(viewer)
            wait_until(lambda: _fetched(f"http://127.0.0.1:{urlsplit(page).port}/"), "the viewer's page")
            wait_until(lambda: _answers(served_port(page)), "the recording")
        finally:
            viewer.kill()


def _answers(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=5):
        return True
    return False


def _fetched(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=5) as answer:
            return b"<html" in answer.read().lower()
    except OSError:
        return False


@pytest.mark.processes
def test_a_stalled_viewer_neither_slows_nor_stops_a_run(tmp_path: Path) -> None:
    """The run is paced at ten times real time, and would fall behind if it waited for the viewer."""
    with live_run(tmp_path / "watched", "--speed", "10") as run:
        viewer = StalledViewer(served_port(address(run)))
        try:
            run.communicate()
        finally:
            viewer.close()
    assert run.returncode == 0
    watched = json.loads((tmp_path / "watched" / "summary.json").read_text())
    command = [sys.executable, str(ROOT / "deploy" / "run_local.py"), *SHORT, "--in-process", "--no-recording", "-q"]
    subprocess.run([*command, "--out", str(tmp_path / "alone")], check=True)
    alone = json.loads((tmp_path / "alone" / "summary.json").read_text())
    assert watched["trace_sha256"] == alone["trace_sha256"]
    assert watched["wall_s"] < 30 / 10 + 12, "start-up, thirty seconds at tenfold speed, and the end"
    assert (tmp_path / "watched" / "recording.rrd").stat().st_size > 50_000
