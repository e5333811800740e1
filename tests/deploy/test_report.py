"""The report of a run: what it says, that nothing in a file can break out of it, and how it refuses bad input."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from deploy.in_process import run_in_process
from deploy.page.charts import Bar, Line, Mark, bar_chart, line_chart
from deploy.page.comparison_page import comparison_page
from deploy.page.html import percent
from deploy.page.run_page import repeat_command, report_page
from deploy.report import main
from deploy.run_folder.reader import read_run
from deploy.run_folder.status import STATUSES
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from deploy.screen.view import NoView
from tests import ROOT
from tests.helpers.report_runs import EVIL, evil_run, short_run


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_run(tmp_path_factory.mktemp("runs") / "plain")


@pytest.fixture(scope="module")
def faulted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_run(tmp_path_factory.mktemp("runs") / "faulted", "kill:2@5")


class Page(HTMLParser):
    """Text, tags and attributes of a page; complains about tags that do not match."""

    VOID = frozenset({"meta", "link", "br", "path", "rect", "circle", "image"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == [], "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID or (tag == "path" and not self.get_starttag_text().endswith("/>")):  # type: ignore[union-attr]
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def assert_harmless(page: Page) -> None:
    """No script, no handler, nothing to fetch."""
    for tag, attributes in page.tags:
        assert tag not in {"script", "img", "iframe", "object", "a", "form"}
        assert not [name for name in attributes if name.startswith("on")]
        for name in ("src", "href"):
            assert (attributes.get(name) or "data:").startswith("data:")


def test_a_report_says_what_the_summary_says(faulted: Path) -> None:
    page = Page(report_page(read_run(faulted)))
    summary = json.loads((faulted / "summary.json").read_text())
    assert_harmless(page)
    for words in (
        "three_cells, 4 robots, seed 1", "time limit reached", f"{summary['simulated_s']:.1f} s simulated",
        f"{summary['connected_fraction'] * 100:.2f} %", summary["trace_sha256"], f"{summary['scan_reports']['made']}",
        "kill 2", "Cell 1", "Cell 3", f"0 of {summary['victims']['placed']}",
    ):  # fmt: skip
        assert words in page.text, words
    titles = [attributes.get("aria-label") for tag, attributes in page.tags if tag == "svg" and "role" in attributes]
    assert {"Searched share of each cell", "Connectivity", "Hops to the MS", "Map of faulted"} <= set(titles)
    assert sum(tag == "circle" for tag, _ in page.tags) >= 3, "the living robots are on the map"
    gone = [a for tag, a in page.tags if tag == "path" and a.get("class") == "gone"]
    assert len(gone) == 2, "the killed robot is on the map and in its key"


def test_the_command_in_the_report_repeats_the_run(faulted: Path, tmp_path: Path) -> None:
    page = report_page(read_run(faulted))
    command = repeat_command(read_run(faulted))
    assert command in Page(page).text
    script, *arguments = shlex.split(command)
    assert "--fault" not in arguments, "the scenario has it already"
    again = [sys.executable, ROOT / script, *arguments, "--in-process", "--no-recording", "-q", "--out", tmp_path]
    subprocess.run(again, check=True)
    before, after = (json.loads((path / "summary.json").read_text()) for path in (faulted, tmp_path))
    assert before["trace_sha256"] == after["trace_sha256"]


def test_the_command_repeats_faults_of_a_hand_beside_planned_ones_of_the_same_verb_and_tick(
    faulted: Path, tmp_path: Path
) -> None:
    """Robot 2 was killed by schedule at 5 s, and robot 3 by hand at the same tick."""
    twice = short_run(tmp_path / "twice", "kill:2@5", "kill:3@5")
    shutil.copytree(twice, tmp_path / "by hand")
    shutil.copyfile(faulted / "scenario.toml", tmp_path / "by hand" / "scenario.toml")
    summary = json.loads((twice / "summary.json").read_text())
    (tmp_path / "by hand" / "summary.json").write_text(json.dumps({**summary, "wall_clock_faults": 1}))
    run = read_run(tmp_path / "by hand")
    page = Page(report_page(run)).text
    assert "1 of its faults came at a moment of wall time" in page
    assert f"ends with the same digest: {summary['trace_sha256']}" in page
    script, *arguments = shlex.split(repeat_command(run))
    again = [sys.executable, ROOT / script, *arguments, "--in-process", "--no-recording", "-q", "--out", tmp_path / "r"]
    subprocess.run(again, check=True, timeout=300)
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["trace_sha256"] == summary["trace_sha256"]


@pytest.mark.parametrize("status", STATUSES)
def test_the_page_speaks_of_every_status_in_words_and_promises_no_digest_of_half_a_run(
    status: str, plain: Path, tmp_path: Path
) -> None:
    shutil.copytree(plain, tmp_path / "run")
    summary = json.loads((plain / "summary.json").read_text())
    (tmp_path / "run" / "summary.json").write_text(json.dumps({**summary, "status": status}))
    page = Page(report_page(read_run(tmp_path / "run"))).text
    assert STATUSES[status].words in page
    assert "_" not in STATUSES[status].words
    assert ("same digest" in page) == (status in ("searched", "time_limit", "exhausted", "no_robots"))


def test_a_comparison_shows_both_and_the_difference(plain: Path, faulted: Path) -> None:
    html = comparison_page(read_run(plain), read_run(faulted))
    page = Page(html)
    assert_harmless(page)
    assert "plain and faulted" in page.text
    assert "faults 0 1 +1" in page.text
    assert "robots 4 4 same" in page.text
    assert "same to the bit no" in page.text
    assert "dashed" in html
    assert "same to the bit yes" in Page(comparison_page(read_run(plain), read_run(plain))).text


def test_nothing_in_a_file_breaks_out_of_the_page(plain: Path, tmp_path: Path) -> None:
    run = read_run(evil_run(plain, tmp_path / "<b>&evil"))
    for page in (Page(report_page(run)), Page(comparison_page(run, run))):
        assert_harmless(page)
        assert "alert(1)" in page.text, "it is there, as text"
        assert not any(tag == "b" for tag, _ in page.tags)
    assert EVIL in " ".join(Page(report_page(run)).words)


def test_the_page_forbids_itself_to_load_anything(plain: Path) -> None:
    policy = [a["content"] for tag, a in Page(report_page(read_run(plain))).tags if "http-equiv" in a]
    assert policy == ["default-src 'none'; style-src 'unsafe-inline'; img-src data:"]


def test_a_run_that_failed_early_still_has_a_report(plain: Path, tmp_path: Path) -> None:
    folder = tmp_path / "failed"
    folder.mkdir()
    summary = {"status": "failed", "failures": ["world (pid 5) ended by SIGKILL"], "search_rate": None, "recoveries": 7}
    (folder / "summary.json").write_text(json.dumps(summary))
    header = (plain / "metrics.csv").read_text().splitlines()[0]
    (folder / "metrics.csv").write_text(header + "\n")
    page = Page(report_page(read_run(folder)))
    assert "ended by SIGKILL" in page.text
    assert "left no map" in page.text


def _damage(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(content)


def _pipe(name: str) -> Callable[[Path], object]:
    def replace(folder: Path) -> None:
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return replace


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "no folder": (shutil.rmtree, "no such run folder"),
    "no summary": (lambda folder: (folder / "summary.json").unlink(), "summary.json"),
    "summary cut off": (_damage("summary.json", b'{"status": "sea'), "summary.json"),
    "summary of another kind": (_damage("summary.json", b"[1, 2]"), "summary.json"),
    "summary not text": (_damage("summary.json", b"\xff\xfe\x00"), "summary.json"),
    "no metrics": (lambda folder: (folder / "metrics.csv").unlink(), "metrics.csv"),
    "metrics without time": (_damage("metrics.csv", b"a,b\n1,2\n"), "time_s"),
    "metrics with words": (_damage("metrics.csv", b"time_s,max_hops\n1,two\n"), "line 2"),
    "map without image": (lambda folder: (folder / "map.pgm").unlink(), "map.yaml"),
    "map damaged": (_damage("map.pgm", b"P5 what"), "map.yaml"),
    "map of another kind": (_damage("map.yaml", b"- 1\n"), "map.yaml"),
    "metrics with a column twice": (_damage("metrics.csv", b"time_s,a,a\n1,2,3\n"), "two columns"),
} | {
    f"{name} a pipe": (_pipe(name), "a pipe or a device")
    for name in ("summary.json", "metrics.csv", "events.jsonl", "scenario.toml", "map.yaml", "map.pgm")
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_status_2(
    name: str, plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage, word = BAD[name]
    shutil.copytree(plain, tmp_path / "run")
    damage(tmp_path / "run")
    for arguments in ([tmp_path / "run"], ["--compare", plain, tmp_path / "run"]):
        assert main([str(a) for a in [*arguments, "--out", tmp_path / "r.html"]]) == 2
        told = capsys.readouterr()
        assert told.out == ""
        assert word in told.err
        assert told.err.count("\n") == 1
    assert not (tmp_path / "r.html").exists()


def test_a_folder_that_cannot_be_looked_into_is_one_line(
    plain: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def forbidden(_: Path, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    def ask(*arguments: object) -> str:
        assert main([*map(str, arguments), "--out", str(tmp_path / "r.html")]) == 2
        told = capsys.readouterr()
        assert (told.out, told.err.count("\n")) == ("", 1)
        assert "can't look into it: " in told.err
        return told.err

    assert "name too long" in ask("n" * 5000)
    assert "name too long" in ask("--compare", plain, "n" * 5000)
    monkeypatch.setattr(Path, "stat", forbidden)  # whoever runs the tests may look into everything
    assert "Permission denied" in ask(plain)


def test_a_page_goes_into_no_pipe_and_no_device(
    plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    for out in tmp_path / "pipe", Path(os.devnull), tmp_path:
        assert main([str(plain), "--out", str(out)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not out.is_file()


def test_any_name_that_a_cell_may_have_comes_back(tmp_path: Path) -> None:
    cell = 'a "b", c\'d e\u00e9 = \\ </td>'
    asked = {"robots": 1, "duration_s": 1.0, "cell": [{"name": cell, "rectangle_m": [2.0, 2.0, 18.0, 38.0]}]}
    scenario = load("three_cells", asked)
    with RunFolder(tmp_path / "run", scenario) as folder:
        run_in_process(scenario, folder, NoView(), record=False)
    run = read_run(tmp_path / "run")
    assert list(run.search_rates) == [cell]
    assert_harmless(Page(report_page(run)))


@pytest.mark.parametrize("arguments", [[], ["a", "--compare", "a", "b"], ["--compare", "a"], ["--colour", "a"]])
def test_wrong_options_are_one_line_and_status_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_script_writes_beside_the_run_or_where_it_is_told(plain: Path, tmp_path: Path) -> None:
    def report(*arguments: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, str(ROOT / "deploy" / "report.py"), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)

    shutil.copytree(plain, tmp_path / "run")
    assert report("run").stdout == "report: run/report.html\n"
    assert report("--compare", plain, "run").stdout == "report: run/comparison.html\n"
    assert report("run", "--out", "mine.html").returncode == 0
    written = (tmp_path / "run" / "report.html", tmp_path / "run" / "comparison.html", tmp_path / "mine.html")
    assert all(path.read_text().startswith("<!doctype html>") for path in written)
    refused = report("run", "--out", "/dev/null/mine.html")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)


def test_shares_are_never_rounded_up_to_all() -> None:
    assert [percent(share, 1) for share in (1.0, 0.99999, 0.5, None)] == ["100.0 %", "99.9 %", "50.0 %", "\u2013"]
    assert percent(0.9999) == "99 %"


def _coordinates(svg: str, css: str) -> list[tuple[float, float]]:
    path = re.search(rf'class="{css}" d="([^"]*)"', svg)
    assert path is not None
    return [(float(x), float(y)) for x, y in re.findall(r"[ML]([\d.]+) ([\d.]+)", path[1])]


def test_curves_keep_their_shape_and_break_where_nothing_is_known() -> None:
    line = Line("a", [(0.0, 0.0), (50.0, 0.5), (60.0, None), (100.0, 1.0)], 0)
    svg = line_chart("t", "d", [line], y_name="y", y_max=1.0)
    (x0, y0), (x1, y1), (x2, y2) = _coordinates(svg, "line s0")
    assert x0 < x1 < x2
    assert y0 - y1 == pytest.approx(y1 - y2, abs=0.2)
    assert x1 - x0 == pytest.approx(x2 - x1, abs=0.2)
    path: Any = re.search(r'class="line s0" d="([^"]*)"', svg)
    assert path[1].count("M") == 2


def test_a_long_run_is_thinned_but_keeps_its_dips() -> None:
    points = [(float(i), 0.0 if i == 77_777 else 9.0) for i in range(100_000)]
    svg = line_chart("t", "d", [Line("a", points, 0)], y_name="y")
    spots = _coordinates(svg, "line s0")
    assert len(spots) < 4_000
    assert max(y for _, y in spots) > min(y for _, y in spots) + 100


def test_close_marks_share_a_label_and_all_have_a_title() -> None:
    marks = [Mark(10.0, "kill 1"), Mark(10.5, "kill <2>"), Mark(90.0, "kill 3")]
    svg = line_chart("t", "d", [Line("a", [(0.0, 1.0), (100.0, 1.0)], 0)], y_name="y", marks=marks)
    assert svg.count('class="mark-name') == 2
    assert "<title>kill &lt;2&gt;</title>" in svg


def test_bars_lie_longest_first() -> None:
    svg = bar_chart("t", [Bar("a", 0.1, "10 %"), Bar("b", 0.4, "40 %")])
    widths = [float(width) for width in re.findall(r'class="bar"[^>]* width="([\d.]+)"', svg)]
    assert svg.index(">b<") < svg.index(">a<")
    assert widths[0] == pytest.approx(4 * widths[1], rel=0.01)
