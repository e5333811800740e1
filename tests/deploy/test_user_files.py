"""No command writes in place of a file of the user's, or outside of the folder that it was given."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from deploy import command, study
from deploy.in_process import run_in_process
from deploy.run_folder.writer import RunFolder
from deploy.scenario import ScenarioError, load
from deploy.scenario.name import name_of
from deploy.screen.view import NoView
from deploy.sweep.plan import load_study
from tests import ROOT
from world.own_file import write_whole

MAP = """\
image: map.pgm
resolution: 0.5
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
STUDY = """
scenario = "three_cells"
plot = "search_time"
[set]
robots = 1
duration_s = 1.0
[axes]
radius_m = [20.0]
"""
BAD_NAMES = ["../../escape", "/abs", ".", "..", ".hidden", "-rf", " x", "x ", "", "a/b", "a\nb", "a\0b", "n" * 300]


def ask(script: str, *arguments: object, cwd: Path) -> tuple[int, str, str]:
    words = [sys.executable, str(ROOT / "deploy" / script), *map(str, arguments)]
    ended = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    return ended.returncode, ended.stdout, ended.stderr


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    """A folder of the user's with a map in it."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "map.yaml").write_text(MAP)
    (tmp_path / "maps" / "map.pgm").write_bytes(b"P5 40 40 255\n" + b"\xfe" * 1600)
    return tmp_path / "maps"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run that has ended."""
    scenario = load("three_cells", {"robots": 1, "duration_s": 1.0})
    with RunFolder(tmp_path / "run", scenario) as folder:
        run_in_process(scenario, folder, NoView(), record=False)
    return tmp_path / "run"


# Runs


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)])
@pytest.mark.parametrize("engine", [(), ("--in-process",)])
def test_a_run_keeps_out_of_the_folder_of_its_map(
    maps: Path, overwrite: tuple[str, ...], engine: tuple[str, ...]
) -> None:
    before = contents(maps)
    asked = ("--scenario", "map.yaml", "--out", ".", "--robots", 1, "--duration", 1, *overwrite, *engine)
    status, out, errors = ask("run_local.py", *asked, cwd=maps)
    assert (status, out, errors.count("\n")) == (2, "", 1)
    assert "--out .: holds map.pgm, which no run wrote" in errors
    assert contents(maps) == before


def test_a_run_repeats_itself_elsewhere_only(run: Path) -> None:
    before = contents(run)
    for words in (
        ("--scenario", "map.yaml"),
        ("--scenario", "scenario.toml"),
        ("--replay-faults", "."),
        ("--compare", "."),
    ):
        asked = (*words, "--out", ".", "--overwrite", "--robots", 1, "--duration", 1, "--in-process")
        status, _, errors = ask("run_local.py", *asked, cwd=run)
        assert (status, errors.count("\n")) == (2, 1), errors
        assert f"--out .: this run reads {words[1]}" in errors
        assert contents(run) == before


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_never_leads_out_of_its_folder(name: str) -> None:
    with pytest.raises(ScenarioError, match="name = ") as caught:
        load("three_cells", {"name": name})
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_a_bad_name_is_refused_wherever_it_stands(tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text((ROOT / "deploy" / "scenarios" / "three_cells.toml").read_text() + "\n")
    text = (tmp_path / "my.toml").read_text()
    (tmp_path / "my.toml").write_text(text.replace('name = "three_cells"', 'name = "../../escape"'))
    short = ("--in-process", "--no-recording", "--robots", 1, "--duration", 1)
    for words in ("--scenario", "my.toml"), ("--set", 'name="../../escape"'), ("--set", "name=.."):
        status, out, errors = ask("run_local.py", *words, *short, cwd=tmp_path)
        assert (status, out, errors.count("\n")) == (2, "", 1), errors
    assert {path.name for path in tmp_path.iterdir()} == {"my.toml"}


@pytest.mark.parametrize("stem", ["-x", "..", ".", " a b ", "a\nb", "é" * 200, "map", "x" * 240])
def test_a_map_may_have_any_name(stem: str) -> None:
    load("three_cells", {"name": name_of(stem)})


# Studies, reports and measurements


def test_a_study_keeps_to_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "tiny.toml").write_text(STUDY)
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "results.csv").write_text("mine")
    before = contents(tmp_path)
    asked = ("tiny.toml", "--workers", 1, "--out")
    for more in (), ("--plot-only",):
        status, _, errors = ask("study.py", *asked, "thesis", *more, cwd=tmp_path)
        assert (status, errors.count("\n")) == (2, 1), errors
        assert "holds results.csv, which no study wrote" in errors
    assert ask("study.py", *asked, "new", "--plot-only", cwd=tmp_path)[0] == 2
    assert contents(tmp_path) == before
    assert not (tmp_path / "new").exists(), "nothing was to be drawn"
    assert ask("study.py", *asked, "new", cwd=tmp_path)[0] == 0
    assert ask("study.py", *asked, "new", cwd=tmp_path)[0] == 0, "it goes on where it was"
    (tmp_path / "new" / "notes.txt").write_text("mine")
    assert "holds notes.txt" in ask("study.py", *asked, "new", cwd=tmp_path)[2]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_the_name_of_a_study_never_leads_out_of_its_folder(tmp_path: Path, name: str) -> None:
    escaped = name.encode("unicode_escape").decode().replace("\\x00", "\\u0000")
    text = f'name = "{escaped}"\nscenario = "three_cells"\nplot = "variants"\n'
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(ScenarioError, match="name"):
        load_study(str(tmp_path / "s.toml"))


def test_a_report_without_results_leaves_the_pages_that_are_there(tmp_path: Path) -> None:
    """A fresh clone has no studies but the committed tables: without one of them pages would lose what they show."""
    docs = tmp_path / "docs"
    shutil.copytree(ROOT / "docs", docs)
    (docs / "results" / "fig7.csv").unlink()
    before = contents(docs)
    status, out, errors = ask("study.py", "report", "--out", docs, cwd=tmp_path)
    assert (status, out, errors.count("\n")) == (2, "", 1)
    assert "keeps its pages" in errors
    assert "fig7" in errors
    assert contents(docs) == before


def test_a_report_of_an_installed_package_needs_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "ROOT", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert study.main(["report"]) == 2
    told = capsys.readouterr()
    assert "is no checkout" in told.err
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["results.md", "policies.md", "results/fig6.png"])
def test_a_report_keeps_off_pages_of_the_users(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    status, _, errors = ask("study.py", "report", "--out", ".", cwd=tmp_path)
    assert (status, errors.count("\n")) == (2, 1), errors
    assert contents(tmp_path) == {name: b"mine"}


def test_a_page_replaces_a_page_only(run: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.html").write_text("mine")
    status, _, errors = ask("report.py", "run", "--out", "thesis.html", cwd=tmp_path)
    assert (status, errors.count("\n")) == (2, 1), errors
    assert (tmp_path / "thesis.html").read_text() == "mine"
    for _ in range(2):
        assert ask("report.py", "run", cwd=tmp_path)[0] == 0
    shutil.copyfile(run / "scenario.toml", run / "comparison.html")
    assert ask("report.py", "--compare", "run", "run", cwd=tmp_path)[0] == 2
    assert (run / "comparison.html").read_bytes() == (run / "scenario.toml").read_bytes()


@pytest.mark.parametrize("name", ["page.html.part", "page.html.2.part"])
def test_a_file_that_is_written_passes_by_what_has_the_name_of_its_draft(tmp_path: Path, name: str) -> None:
    for each in ("page.html.part", name):
        (tmp_path / each).write_text("precious")
    before = contents(tmp_path)
    for text in ("first", "second"):
        write_whole(tmp_path / "page.html", text)
        assert contents(tmp_path) == {**before, "page.html": text.encode()}


def test_a_file_that_cannot_be_written_leaves_no_draft(tmp_path: Path) -> None:
    (tmp_path / "page.html").mkdir()
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path / "page.html", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_benchmark_replaces_a_benchmark_only(tmp_path: Path) -> None:
    (tmp_path / "package.json").write_text('{"mine": 1}')
    for file in tmp_path / "package.json", tmp_path / "none" / "bench.json":
        words = [sys.executable, "-m", "tests.bench", "--quick", "--json", str(file)]
        ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
        assert (ended.returncode, ended.stdout) == (2, ""), "before anything is measured"
        assert file.name in ended.stderr
    assert (tmp_path / "package.json").read_text() == '{"mine": 1}'


@pytest.mark.parametrize(("status", "arguments", "kept"), [(1, "", True), (0, "missions", True), (0, "", False)])
def test_only_a_whole_acceptance_that_is_met_replaces_its_page(
    tmp_path: Path, status: int, arguments: str, kept: bool
) -> None:
    for folder in "docs", ".venv/bin":
        (tmp_path / folder).mkdir(parents=True)
    shutil.copyfile(ROOT / "Makefile", tmp_path / "Makefile")
    (tmp_path / "docs" / "acceptance.md").write_text("before\n")
    (tmp_path / ".venv" / "bin" / "python").write_text(f"#!/bin/sh\necho after\nexit {status}\n")
    (tmp_path / ".venv" / "bin" / "python").chmod(0o755)
    words = ["make", "-o", "setup", "acceptance", "VENV=.venv", f"ARGS={arguments}"]  # whichever `make` runs the tests
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert bool(ended.returncode) == bool(status), ended.stderr
    assert (tmp_path / "docs" / "acceptance.md").read_text() == ("before\n" if kept else "after\n")
