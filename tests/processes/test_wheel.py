"""The package as others depend on it: a wheel in a fresh environment, and folders with packages of the same names."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy.page.html import GENERATOR
from tests import ROOT
from vds.packages import PACKAGES

# pip may wait for the registry, and a busy machine compiles for minutes.
pytestmark = [pytest.mark.processes, pytest.mark.timeout(0)]

Ask = Callable[..., subprocess.CompletedProcess[str]]

OWN_TESTS = """\
import world


def test_mine():
    assert world.MINE


def test_theirs(emulation):
    emulation()
"""
VALIDATE = """\
import json, sys, tomllib
import jsonschema
from deploy.scenario.files import FOLDER

check = jsonschema.validators.validator_for(schema := json.load(sys.stdin))
check.check_schema(schema)
for path in FOLDER.glob("*.toml"):
    scenario = tomllib.loads(path.read_text())
    check(schema).validate(scenario)
    print(path.stem, check(schema).is_valid(scenario | {"radoi": {}}), check(schema).is_valid(scenario | {"robots": 0}))
"""
TYPED = """\
import vds

robots: int = vds.load("three_cells").robots
digest: str = vds.Simulation(vds.load("three_cells")).run().trace_sha256
vds.load(3)
"""


@pytest.fixture(scope="module")
def bin_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`bin` of an environment with the wheel, made from a copy of the sources without anything that was built."""
    home = tmp_path_factory.mktemp("wheel")
    built = shutil.ignore_patterns("*.so", "__pycache__")
    for name in (*PACKAGES, "vds"):
        shutil.copytree(ROOT / name, home / "source" / name, ignore=built)
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "constraints.txt"):
        shutil.copy(ROOT / name, home / "source" / name)
    subprocess.run([sys.executable, "-m", "venv", home / "env"], check=True)
    pip = [home / "env" / "bin" / "python", "-m", "pip", "--quiet", "--disable-pip-version-check"]
    env = {**os.environ, "PIP_CONSTRAINT": str(ROOT / "constraints.txt")}
    env.pop("PYTHONPATH", None)
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", home, home / "source"], env=env, check=True)
    shutil.rmtree(home / "source")
    (wheel,) = home.glob("*.whl")
    subprocess.run([*pip, "install", f"{wheel}[completion]", "pytest", "jsonschema"], env=env, check=True)
    return home / "env" / "bin"


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """A folder with packages `agents`, `world` and `deploy` of the user's own, and tests."""
    for name in ("agents", "world", "deploy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("MINE = True\n")
    (tmp_path / "test_own.py").write_text(OWN_TESTS)
    return tmp_path


@pytest.fixture
def ask(bin_folder: Path, theirs: Path) -> Ask:
    """Call a program of the environment, from that folder."""
    env = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "PYTEST"))}

    def call(program: str, *words: str, said: str | None = None) -> subprocess.CompletedProcess[str]:
        asked = [str(bin_folder / program), *words]
        return subprocess.run(asked, cwd=theirs, env=env, input=said, capture_output=True, text=True, check=False)

    return call


def test_the_command_runs_and_reports_and_names_itself(ask: Ask, theirs: Path) -> None:
    ended = ask("vds", "run", "--robots", "2", "--duration", "4", "--out", "one")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "as a page: vds report one" in ended.stdout
    assert "recording: vds open one" in ended.stdout
    many = json.loads((theirs / "one" / "summary.json").read_text())
    ask("vds", "run", "--robots", "2", "--duration", "4", "--out", "two", "--in-process", "--no-recording")
    alone = json.loads((theirs / "two" / "summary.json").read_text())
    assert many["trace_sha256"] == alone["trace_sha256"]
    assert ask("vds", "report", "one").stdout == "report: one/report.html\n"
    page = (theirs / "one" / "report.html").read_text()
    assert "vds run --scenario one/scenario.toml" in page
    said = ended.stdout + page + ask("vds", "ctl", "status").stderr + ask("vds", "study", "fig6").stderr
    assert "vds ctl: no run is under way here" in said
    assert "pip install 'vds-emulator[study]'" in said
    assert not any(word in said.replace(GENERATOR, "") for word in ("deploy/", "make setup", "run_local", "ctl.py"))


def test_what_ships_is_there(ask: Ask) -> None:
    assert 'name = "hospital_ward"' in ask("vds", "scenario", "hospital_ward").stdout
    examples = ask("vds", "examples").stdout.splitlines()[::2]
    assert len(examples) == 2
    assert all(Path(path).is_file() for path in examples)
    own = ("--policy", "vds.examples.nearest_frontier:NearestFrontier", "--in-process", "--no-recording", "-q")
    assert ask("vds", "run", *own, "--robots", "1", "--duration", "1").returncode == 0


def test_a_shell_completes_verbs_and_options(ask: Ask) -> None:
    script = ask("vds", "completion", "bash").stdout
    for typed, completed in (("vds st", "study"), ("vds run --rep", "--replay-faults")):
        words = typed.split()
        tab = (
            f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _shtab_vds vds {words[-1]} {words[-2]}\n"
            'echo "${COMPREPLY[@]}"\n'
        )
        told = subprocess.run(["bash"], input=script + tab, capture_output=True, text=True, check=True)
        assert (told.stdout, told.stderr) == (f"{completed}\n", "")


def test_the_schema_takes_every_scenario_that_ships(ask: Ask) -> None:
    schema = ask("vds", "scenario", "--schema").stdout
    ended = ask("python", "-P", "-c", VALIDATE, said=schema)
    assert ended.stderr == ""
    assert len(ended.stdout.splitlines()) > 10
    assert all(line.endswith(" False False") for line in ended.stdout.splitlines())


def test_a_users_own_packages_stay_his(ask: Ask, theirs: Path) -> None:
    ended = ask("python", "-m", "pytest", "-q", "test_own.py")
    assert "1 passed, 1 error" in ended.stdout
    assert f"{theirs / 'world'} hides the package `world` of the VDS emulator: rename it" in ended.stdout
    for name in ("agents", "world", "deploy"):
        shutil.rmtree(theirs / name)
    (theirs / "test_own.py").write_text(
        "def test_run(emulation):\n    assert emulation(robots=1, duration_s=1.0).summary['ticks'] == 11\n"
    )
    ended = ask("python", "-m", "pytest", "-q", "test_own.py")
    assert "assert 10 == 11" in ended.stdout
    assert (theirs / ".pytest_cache/d/vds-runs/test_own.py-test_run/run-1/summary.json").exists()


def test_a_users_program_is_checked_by_the_types_that_ship(bin_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(TYPED)
    asked = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(bin_folder / "python"), "own.py"]
    ended = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.stdout.splitlines()[:-1] == [
        'own.py:5: error: Argument 1 to "load" has incompatible type "int"; expected "str | Path"  [arg-type]'
    ]
