"""Sizes of files and rooms, and the table of CONTRIBUTING.md that answers "where would I change X"."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import ROOT

PACKAGES = ("agents", "bus", "deploy", "medium", "monitor_station", "vds", "world")
MOST_LINES = 350
MOST_MODULES = 9
"""Most modules of a room of deploy/ besides `__init__`."""


def test_no_source_is_too_long() -> None:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py*") if path.suffix in (".py", ".pyx")]
    assert len(paths) > 100
    lines = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in paths}
    assert {path: count for path, count in lines.items() if count > MOST_LINES} == {}


ROOMS = sorted(path.parent for path in (ROOT / "deploy").glob("*/__init__.py"))


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_no_room_is_too_full(room: Path) -> None:
    assert len([path for path in room.glob("*.py") if path.stem != "__init__"]) <= MOST_MODULES


def test_the_map_of_the_packages_names_every_module() -> None:
    section = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Packages")[2].partition("\n## ")[0]
    modules: dict[str, list[str]] = {}
    for package in (name for name in PACKAGES if name != "deploy"):
        (words,) = re.findall(rf"^\* `{package}`(.+?)(?=^\* |\Z|^$)", section, re.MULTILINE | re.DOTALL)
        paths = [path for path in (ROOT / package).rglob("*.py") if not path.name.startswith("__")]
        modules[package] = [
            str(path.relative_to(ROOT))
            for path in sorted(paths)
            if path.name not in ("config.py", "process.py") and f"`{path.name}`" not in words
        ]
    assert {package: names for package, names in modules.items() if names} == {}


def test_a_newcomer_is_shown_to_files_that_exist() -> None:
    section = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Where would I change")[2]
    rows = [row.groups() for row in re.finditer(r"^\| (.+?) \| (.+) \|$", section, re.MULTILINE)]
    answers = {what: re.findall(r"`([^`]+)`", where) for what, where in rows if what != "what"}
    assert len(answers) >= 10
    assert [what for what, paths in answers.items() if not paths] == []
    assert [path for paths in answers.values() for path in paths if not (ROOT / path).is_file()] == []
