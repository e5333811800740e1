"""The list of mutants fits the sources, and what is generated is Python; whether tests catch them: `make mutants`."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests import ROOT
from tests.mutants.generated import generated
from tests.mutants.mutant import HELD_BY
from tests.mutants.planted import PlantedError, planted


def test_every_planted_mutant_changes_its_file_and_names_tests_that_exist() -> None:
    mutants = planted(ROOT)
    assert len({mutant.what for mutant in mutants}) == len(mutants) >= 60
    for mutant in mutants:
        original = (ROOT / mutant.path).read_text(encoding="utf-8")
        assert mutant.text_of(original) != original
        if mutant.path.endswith(".py"):
            ast.parse(mutant.text_of(original))
        for test in mutant.tests:
            path, _, function = test.partition("::")
            assert f"def {function}" in (ROOT / path).read_text(encoding="utf-8")


def test_a_planted_mutant_that_does_not_fit_any_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "agents" / "body.py"
    path.parent.mkdir()
    path.write_text("nothing of the kind")
    with pytest.raises(PlantedError, match="MSR rule 2 by straight line: agents/body"):
        planted(tmp_path)


@pytest.mark.parametrize("path", HELD_BY)
def test_every_generated_mutant_is_python_and_another_program(path: str) -> None:
    original = (ROOT / path).read_text(encoding="utf-8")
    mutants = list(generated(ROOT, path))
    assert len(mutants) > 30
    program = ast.dump(ast.parse(original))
    for mutant in mutants:
        assert ast.dump(ast.parse(mutant.text_of(original))) != program, mutant.what
