"""pytest's plugin: what a failed test shows of its runs, and what it keeps of them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tests.helpers.running import assert_readable

pytestmark = pytest.mark.processes

TESTS = """\
RUN = {"robots": 2, "duration_s": 4.0, "faults": ["kill:1@1"]}


def test_good(emulation):
    assert emulation(**RUN).recovery(of=1)["robot"] == 1


def test_value(emulation):
    assert emulation(**RUN).recovery(of=1)["robot"] == 7


def test_error(emulation):
    assert emulation(**RUN).recovery(of=1)["detected_s"] < 3


def test_start(emulation):
    emulation(robots=0)
"""


def test_a_failed_test_shows_its_verdicts_and_keeps_its_runs(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(TESTS)
    earlier = tmp_path / ".pytest_cache" / "d" / "vds-runs" / "test_mine.py-test_value"
    earlier.mkdir(parents=True)
    (earlier / "old").touch()
    asked = [sys.executable, "-m", "pytest", "-p", "vds.pytest_plugin", "--vds-record", "--basetemp", tmp_path / "temp"]
    ended = subprocess.run(
        asked, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert "3 failed, 1 passed" in ended.stdout
    shown = dict(re.findall(r"(?ms)^_+ (test_\w+) _+\n(.+?)(?=^_+ test|^=+ short)", ended.stdout))
    assert re.search(r"1 == 7\s+E\s+of the verdict", shown["test_value"])
    for name in ("test_value", "test_error"):
        assert shown[name].count("  fault: 'kill:1@1'") == 1, "each verdict once"
        kept = earlier.with_name(f"test_mine.py-{name}") / "run-1"
        assert str(kept) in shown[name]
        assert (kept / "summary.json").exists()
        assert_readable(kept / "recording.rrd")
    assert not (earlier / "old").exists()
    assert "three_cells: robots = 0" in shown["test_start"]
    assert not (earlier.with_name("test_mine.py-test_good")).exists()
