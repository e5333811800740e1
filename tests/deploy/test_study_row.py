"""A row of a study: the code that decides it, and errors of any length."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bus.built import LOOPS, built_from
from deploy.run_folder.status import ERROR
from deploy.sweep import row
from deploy.sweep.plan import load_study, points_of
from deploy.sweep.row import Engine, Finished, code_version, digest_of, failed_row, run_point
from deploy.sweep.workers import Execution
from tests import ROOT
from tests.deploy.test_study_execution import Threads
from tests.helpers.studies import tiny

NOT_DECISIVE = {"deploy/__init__.py", "deploy/sweep/__init__.py", "deploy/json_file.py"}
"""What the modules of a run import besides: empty ones, and one that only reads what runs have left."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources."""
    place = tmp_path_factory.mktemp("sources")
    for name in "agents", "bus", "deploy", "medium", "monitor_station", "world":
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("*.so", "__pycache__", "*.toml"))
    return place


def imported_by_a_run() -> set[str]:
    """Sources that a worker has imported when it begins a run."""
    code = (
        "import sys, deploy.simulation, deploy.sweep.row, deploy.processes.launcher\n"
        "print(*(m.__file__ for m in list(sys.modules.values()) if getattr(m, '__file__', None)), sep='\\n')"
    )
    words = [sys.executable, "-c", code]
    said = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True, timeout=300).stdout
    paths = (Path(line) for line in said.splitlines())
    return {
        str(p.relative_to(ROOT))
        for p in paths
        if p.suffix == ".py" and p.is_relative_to(ROOT) and "site-packages" not in p.parts
    }


def test_all_that_decides_a_result_changes_the_version_of_the_code(copy: Path) -> None:
    loops = built_from()
    before = digest_of(copy, loops)
    assert before == code_version()
    decisive = imported_by_a_run() - NOT_DECISIVE
    assert {"deploy/simulation.py", "deploy/scenario/arena.py", "bus/lockstep.py", "agents/vds.py"} <= decisive
    silent = set()
    for name in sorted(decisive):
        source = (copy / name).read_bytes()
        (copy / name).write_bytes(source + b"#")
        if digest_of(copy, loops) == before:
            silent.add(name)
        (copy / name).write_bytes(source)
    assert {name for name in silent if not name.startswith(("deploy/machine/", "deploy/screen/"))} == set()
    for name in LOOPS:
        assert digest_of(copy, {**loops, name: "changed"}) != before


def test_errors_of_any_length_are_one_short_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 2.0))))[0]
    long = "line\n" * 100_000

    def fail(*_: object) -> Finished:
        raise ValueError(long)

    workers = Threads()
    lost = [run.row for _, run in Execution(workers, "in-process", 1, fail).results([point])]
    workers.close()
    monkeypatch.setattr(row, "_run", fail)
    engine: Engine = "in-process"
    ran = run_point(point.key, point.variant, point.toml, engine, 1).row
    for found in (*lost, ran, failed_row(point.key, point.variant, point.toml, engine, long)):
        assert found["status"] == ERROR
        assert "line?line" in found["error"]
        assert len(found["error"]) <= 300
        assert "\n" not in found["error"]
    assert capsys.readouterr().err
