"""The public package: every name, the one-line refusal where a user's package hides ours, the command, the examples."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import vds
from deploy.scenario import ScenarioError, load, names
from deploy.scenario.keys_page import keys_page
from deploy.scenario.schema import schema
from tests import ROOT
from vds.__main__ import VERBS, parser
from vds.open_recording import newest

PAGES = ("README.md", "docs/writing-a-policy.md", "docs/faults.md", "docs/studies.md")


def python(*words: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | environment
    return subprocess.run([sys.executable, *words], cwd=cwd, env=env, capture_output=True, text=True, check=False)


# Names


def test_every_public_name_is_there_with_words_on_it() -> None:
    assert sorted(vds.__all__) == sorted([*(name for names in vds._FROM.values() for name in names), "ShadowedError"])
    without = [
        name
        for name in vds.__all__
        if name not in ("NOBODY", "Place") and not vars(vds).get(name, getattr(vds, name)).__doc__
    ]
    assert without == []
    assert set(vds.__all__) <= set(dir(vds))
    with pytest.raises(AttributeError, match="no attribute 'lod'"):
        vds.lod  # type: ignore[attr-defined]  # noqa: B018


def test_type_checkers_are_told_the_same_names() -> None:
    tree = ast.parse(Path(vds.__file__).read_text(encoding="utf-8"))
    told = {
        (node.module, alias.name, alias.asname or alias.name)
        for block in tree.body if isinstance(block, ast.If)
        for node in block.body if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }  # fmt: skip
    assert told == {
        (module, vds._OTHERWISE.get(name, name), name) for module, names in vds._FROM.items() for name in names
    }


def test_without_a_name_nothing_behind_it_is_imported(tmp_path: Path) -> None:
    ask = "import sys, vds, vds.pytest_plugin, vds.__main__; print(*sys.modules)"
    told = python("-c", ask, cwd=tmp_path, PYTHONPATH=str(ROOT)).stdout
    loaded = {name.partition(".")[0] for name in told.split()}
    assert "vds" in loaded
    assert not loaded & {"bus", "world", "medium", "agents", "monitor_station", "deploy", "numpy"}


@pytest.mark.parametrize("page", PAGES)
def test_pages_import_nothing_but_vds(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    imported = re.findall(
        r"^ *(?:from|import) +(bus|world|medium|agents|monitor_station|deploy|vds)\b", text, re.MULTILINE
    )
    assert set(imported) <= {"vds"}
    assert page != "README.md" or imported


def test_the_example_of_the_first_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """As it stands there, but for 20 simulated seconds."""
    example = next(
        re.finditer(r"(?s)```python\n(import vds\n.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"))
    )[1]
    names: dict[str, Any] = {}
    exec(example.replace('"seed": 3', '"seed": 3, "duration_s": 20.0'), names)
    assert names["traces"].xy_m.shape == (200, 9, 2)
    assert names["result"].trace_sha256 in capsys.readouterr().out


# A user's packages of the same names


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """A folder with packages `agents`, `world` and `deploy` of the user's own."""
    for name in ("agents", "world", "deploy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("MINE = True\n")
    return tmp_path


def test_a_users_package_that_hides_ours_is_named_in_one_line(theirs: Path) -> None:
    (theirs / "own.py").write_text("import vds\nimport world\nassert world.MINE\nvds.load('three_cells')\n")
    ended = python("own.py", cwd=theirs, PYTHONPATH=str(ROOT))
    last = ended.stderr.splitlines()[-1]
    assert ended.returncode == 1
    assert last.startswith(
        f"vds.packages.ShadowedError: {theirs / 'world'} hides the package `world` of the VDS emulator"
    )
    assert f"so that {theirs} is not on its path" in last


def test_a_folder_that_is_no_package_hides_nothing(tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    (tmp_path / "own.py").write_text("import vds\nprint(vds.load('three_cells').name)\n")
    assert python("own.py", cwd=tmp_path, PYTHONPATH=str(ROOT)).stdout == "three_cells\n"


def test_the_command_works_where_the_working_folder_has_such_packages(theirs: Path) -> None:
    words = ("run", "--in-process", "--no-recording", "--robots", "1", "--duration", "1", "--out", "run")
    ended = python("-m", "vds", *words, cwd=theirs, PYTHONPATH=str(ROOT))
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "as a page: vds report run" in ended.stdout
    assert "deploy/" not in ended.stdout


def test_the_command_says_which_package_hides_ours(theirs: Path) -> None:
    ended = python("-c", "from vds.__main__ import enter; enter()", "run", cwd=theirs, PYTHONPATH=str(ROOT))
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith(f"vds: {theirs / 'world'} hides the package `world`")


# The command


def test_each_verb_has_words_and_speaks_as_the_command(tmp_path: Path) -> None:
    assert set(VERBS) == {"run", "ctl", "open", "report", "study", "whatif", "scenario", "examples", "completion"}
    for verb in VERBS:
        ended = python("-m", "vds", verb, "--help", cwd=tmp_path, PYTHONPATH=str(ROOT))
        assert (ended.returncode, ended.stderr) == (0, "")
        assert ended.stdout.startswith(f"usage: vds {verb}")
        assert "deploy/" not in ended.stdout
        wrong = python("-m", "vds", verb, "--nonsense", cwd=tmp_path, PYTHONPATH=str(ROOT))
        assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
        assert wrong.stderr.startswith(f"vds {verb}: ")


def test_the_whole_command_line_is_one_parser() -> None:
    told = parser().format_help()
    assert all(f"  {verb} " in told or f"  {verb}\n" in told for verb in VERBS)
    assert parser().parse_args(["run", "--robots", "3"]).robots == 3


def test_of_the_runs_that_recorded_the_newest_is_opened(tmp_path: Path) -> None:
    assert newest(tmp_path) is None
    for at_s, name in enumerate(("old", "new", "without")):
        (tmp_path / name).mkdir()
        if name != "without":
            (tmp_path / name / "recording.rrd").write_bytes(b"")
        os.utime(tmp_path / name, (at_s, at_s))
    assert newest(tmp_path) == tmp_path / "new"
    ended = python("-m", "vds", "open", str(tmp_path / "without"), cwd=tmp_path, PYTHONPATH=str(ROOT))
    assert (ended.returncode, ended.stderr) == (2, f"vds open: {tmp_path / 'without'}: no recording.rrd there\n")


def test_scenarios_are_listed_and_printed_to_be_copied(tmp_path: Path) -> None:
    def ask(*words: str) -> subprocess.CompletedProcess[str]:
        return python("-m", "vds", "scenario", *words, cwd=tmp_path, PYTHONPATH=str(ROOT))

    assert ask().stdout.split() == names()
    (tmp_path / "mine.toml").write_text(ask("hospital_ward").stdout)
    assert load(tmp_path / "mine.toml").arena.geometry == load("hospital_ward").arena.geometry
    assert ask("hospital").stderr == "vds scenario: unknown scenario 'hospital', did you mean 'hospital_ward'?\n"


def test_examples_are_where_they_are_said_to_be(tmp_path: Path) -> None:
    said = python("-m", "vds", "examples", cwd=tmp_path, PYTHONPATH=str(ROOT)).stdout.splitlines()
    assert [Path(line).name for line in said[::2]] == ["nearest_frontier.py", "nearest_frontier.toml"]
    assert all(Path(line).is_file() for line in said[::2])


# The schema


def leaves(whole: dict[str, Any], table: dict[str, Any], path: str = "") -> list[tuple[str, dict[str, Any]]]:
    """Every key that a command line can set, dotted, with its schema."""
    found = []
    for key, value in table["properties"].items():
        if "$ref" in value:
            found += leaves(whole, whole["$defs"][value["$ref"].rpartition("/")[2]], f"{path}{key}.")
        else:
            found.append((f"{path}{key}", value))
    return found


NUMBERS = [(key, value) for key, value in leaves(schema(), schema()) if value.get("type") in ("number", "integer")]


def test_the_schema_knows_every_bound_that_loading_knows() -> None:
    """A value just beyond a bound is refused with the key's name; no other rule can be meant."""
    assert len(NUMBERS) > 90
    for key, value in NUMBERS:
        for bound, beyond in (("minimum", -1), ("maximum", 1), ("exclusiveMinimum", 0)):
            if bound not in value:
                continue
            wrong = value[bound] + beyond
            with pytest.raises(ScenarioError, match=rf"three_cells: {re.escape(key)} = .*should be"):
                load("three_cells", {key: int(wrong) if value["type"] == "integer" else float(wrong)})


def test_the_schema_has_the_defaults_of_the_tables() -> None:
    tables = load("three_cells").tables
    for key, value in NUMBERS:
        if "default" in value and not key.startswith(("robots", "radius", "seed", "duration")):
            found: Any = tables
            for part in key.split("."):
                found = getattr(found, part)
            assert found == value["default"], key


def test_the_schema_refuses_unknown_keys_and_knows_no_null() -> None:
    whole = schema()
    assert all(table["additionalProperties"] is False for table in (whole, *whole["$defs"].values()))
    assert "null" not in json.dumps(whole)
    assert whole["required"] == ["name", "floor_plan"]
    assert whole["$defs"]["Radio"]["properties"]["loss"]["description"] == "Probability that a receiver loses a frame."


def test_the_page_of_keys_is_current() -> None:
    page = (ROOT / "docs" / "scenario-keys.md").read_text(encoding="utf-8")
    assert page == keys_page(), "write it anew: .venv/bin/vds scenario --keys > docs/scenario-keys.md"
    assert [
        key
        for key, _ in leaves(schema(), schema())
        if f"| `{key.rpartition('.')[2]}` |" not in page and f"## `[[{key}]]`" not in page
    ] == []
