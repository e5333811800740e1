"""The report in a real browser, Debian's chromium, headless: nothing on its console, and no request.

The pictures are kept in the folder that VDS_ARTIFACTS names, else in pytest's own.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from PIL import Image

from deploy.page.comparison_page import comparison_page
from deploy.page.run_page import report_page
from deploy.run_folder.reader import read_run
from tests.helpers.report_runs import evil_run, short_run

pytestmark = pytest.mark.processes

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-default-apps", "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
"""Flags with which chromium makes few requests by itself, and reaches no server."""


class Browser:
    """Opens files and reports text, console and requests."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _run(self, path: Path, *flags: str) -> subprocess.CompletedProcess[str]:
        assert CHROMIUM is not None
        profile = f"--user-data-dir={self._folder / 'profile'}"
        command = [CHROMIUM, *QUIET, profile, *flags, path.as_uri()]
        return subprocess.run(command, capture_output=True, text=True, check=True)

    def read(self, path: Path) -> tuple[str, list[str], list[str]]:
        """Text of the page as the browser built it, its console, and the addresses that were asked for."""
        log = self._folder / "net.json"
        ended = self._run(path, "--dump-dom", "--enable-logging=stderr", "--v=0", f"--log-net-log={log}")
        console = [line for line in ended.stderr.splitlines() if ":CONSOLE" in line]
        starts = (event.get("params", {}) for event in json.loads(log.read_text())["events"])
        # Requests that the browser makes by itself, such as for updates, have no page as their origin.
        by_page = [start for start in starts if start.get("initiator", "not an origin") != "not an origin"]
        asked = {start["url"] for start in by_page if not start["url"].startswith(("file:", "data:"))}
        return re.sub(r"<style>.*?</style>|<[^>]*>", " ", ended.stdout, flags=re.DOTALL), console, sorted(asked)

    def picture(self, path: Path, out: Path, width: int, height: int) -> Image.Image:
        self._run(path, f"--screenshot={out}", f"--window-size={width},{height}")
        with Image.open(out) as image:
            return image.convert("RGB")


@pytest.fixture
def browser(tmp_path: Path) -> Browser:
    if CHROMIUM is None:
        pytest.skip("no chromium: install Debian's package chromium")
    return Browser(tmp_path)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return short_run(folder / "plain"), short_run(folder / "faulted", "kill:2@5")


@pytest.fixture
def artifacts(tmp_path: Path) -> Path:
    folder = Path(os.environ.get("VDS_ARTIFACTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def test_the_report_opens_without_a_word_and_without_a_request(
    browser: Browser, runs: tuple[Path, Path], artifacts: Path
) -> None:
    page = artifacts / "report.html"
    page.write_text(report_page(read_run(runs[1])), encoding="utf-8")
    text, console, asked = browser.read(page)
    assert console == []
    assert asked == []
    summary = json.loads((runs[1] / "summary.json").read_text())
    words = " ".join(text.split())
    for number in (
        summary["trace_sha256"], f"{summary['simulated_s']:.1f} s", f"{summary['connected_fraction'] * 100:.2f} %",
        str(summary["max_hops"]), f"scan reports made {summary['scan_reports']['made']}",
        f"scan reports merged {summary['scan_reports']['merged']}",
    ):  # fmt: skip
        assert number in words, number
    picture = browser.picture(page, artifacts / "report.png", 1280, 1800)
    assert picture.width == 1280
    colors = picture.getcolors(1 << 24)
    shown = {color for count, color in colors or [] if count > 40}
    assert {(86, 180, 233), (0, 158, 115), (0, 114, 178)} <= shown, "robots, station and curves are painted"


def test_two_runs_and_hostile_words_neither(
    browser: Browser, runs: tuple[Path, Path], artifacts: Path, tmp_path: Path
) -> None:
    page = artifacts / "comparison.html"
    page.write_text(comparison_page(*map(read_run, runs)), encoding="utf-8")
    assert browser.read(page)[1:] == ([], [])
    browser.picture(page, artifacts / "comparison.png", 1280, 2000)
    hostile = tmp_path / "hostile.html"
    hostile.write_text(report_page(read_run(evil_run(runs[0], tmp_path / "evil"))), encoding="utf-8")
    text, console, asked = browser.read(hostile)
    assert (console, asked) == ([], [])
    assert "alert(1)" in text


def test_this_would_notice_a_request_and_a_console_error(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text('<!doctype html><img src="http://192.0.2.1/x.png"><script>console.error("no")</script>')
    _, console, asked = browser.read(page)
    assert any('"no"' in line for line in console)
    assert asked == ["http://192.0.2.1/x.png"]


def test_it_fits_a_phone(browser: Browser, runs: tuple[Path, Path], artifacts: Path, tmp_path: Path) -> None:
    """Nothing is wider than the page. A frame stands for a phone, since the browser's window has a least width."""
    page = tmp_path / "report.html"
    page.write_text(report_page(read_run(runs[1])), encoding="utf-8")
    frame = tmp_path / "phone.html"
    frame.write_text(
        '<body style="margin:0;background:#f0f"><iframe src="report.html" style="width:390px;height:3000px;border:0">'
    )
    picture = browser.picture(frame, artifacts / "report_phone.png", 500, 3000)
    assert picture.getpixel((450, 100)) == (255, 0, 255)
    edge = {picture.getpixel((x, y)) for x in range(382, 390) for y in range(0, 2900, 7)}
    assert len(edge) == 1, "content reaches the edge of the page"
