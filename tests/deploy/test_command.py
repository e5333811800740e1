"""The commands' own options and signals: what is refused in one line, and what ends a run in order."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bus.numerals import decimal, whole
from deploy.machine.interrupts import SIGNALS
from tests import ROOT
from tests.helpers.waiting import wait_until

RUN = [sys.executable, str(ROOT / "deploy" / "run_local.py")]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--in-process", "--hold"], "--hold is for real processes"),
        (["--in-process", "--speed", "2"], "--speed is for real processes"),
        (["--in-process", "--port", "7447"], "--port is for real processes"),
        (["--in-process", "--live"], "--live is for real processes"),
        (["--in-process", "--plain-scheduling"], "--plain-scheduling is for real processes"),
        (["--live", "--no-recording"], "--live watches the station record"),
        (["--policy", ":"], "policy = ':': should be one of vds, scout, sortie, or module:Class"),
        (["--port=\u0661"], "argument --port: '\u0661' is not a whole number"),
        (["--robots", "1_0"], "argument --robots: '1_0' is not a whole number"),
        (["--seed", "9" * 5000], "argument --seed"),
        (["--radius", "\u0662"], "argument --radius: '\u0662' is not a number"),
        (["--speed", "\u0662"], "--speed \u0662: expected max or a number"),
        (["--owner", "-1"], "--owner -1: not the id of a process"),
        (["--owner", "9" * 30], "not the id of a process"),
    ],
)
def test_what_a_run_cannot_do_is_refused_in_one_line(options: list[str], words: str, tmp_path: Path) -> None:
    ended = subprocess.run([*RUN, *options], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_scenarios_speed_is_not_dropped_in_silence(tmp_path: Path) -> None:
    short = ("--in-process", "--no-recording", "--robots", "1", "--duration", "1", "--set", "speed=2", "--out", "run")
    ended = subprocess.run([*RUN, *short], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True)
    assert "the scenario's speed = 2 is for real processes" in ended.stdout


@pytest.mark.parametrize("number", SIGNALS)
def test_each_signal_ends_a_run_in_one_process_in_order(number: signal.Signals, tmp_path: Path) -> None:
    long = ("--in-process", "--no-recording", "--robots", "2", "--duration", "100000", "--out", "run")
    with subprocess.Popen([*RUN, *long], cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as running:
        try:
            wait_until(lambda: len(rows(tmp_path / "run" / "metrics.csv")) > 3, "some seconds are simulated")
            os.kill(running.pid, number)
            _, errors = running.communicate()
        finally:
            running.kill()
    assert (running.returncode, errors) == (0, b"")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "interrupted"


def rows(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []


@pytest.mark.parametrize("text", ["", " ", "\u0661", "1_0", "1.5", "nan", "0x1", "1" * 5000, "--1", "1e3"])
def test_only_plain_digits_are_a_whole_number(text: str) -> None:
    with pytest.raises(ValueError, match="not a whole number"):
        whole(text)


@pytest.mark.parametrize("text", ["", ".", "\u0661", "1_0", "nan", "inf", "1e", "1" * 5000, "e5"])
def test_only_plain_digits_are_a_number(text: str) -> None:
    with pytest.raises(ValueError, match="not a number"):
        decimal(text)


def test_numbers_are_what_they_look_like() -> None:
    assert [whole(text) for text in ("0", " 12 ", "-3", "+4")] == [0, 12, -3, 4]
    assert [decimal(text) for text in ("0", "1.", ".5", "-1e3", "1E-2", "1e999")] == [
        0.0, 1.0, 0.5, -1e3, 1e-2, float("inf"),
    ]  # fmt: skip
