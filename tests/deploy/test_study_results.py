"""The results of a study on disk."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from deploy.run_folder.claim import ClaimError
from deploy.run_folder.status import ERROR, STATUSES
from deploy.run_folder.summary import shortfall
from deploy.study import main
from deploy.sweep.plan import load_study, points_of
from deploy.sweep.results import Results, ResultsError, differences
from deploy.sweep.row import Finished
from deploy.sweep.statistics import usable
from tests import ROOT
from tests.helpers.studies import row, tiny
from tests.helpers.study_workers import pretend


def finished(key: str, **more: Any) -> Finished:
    cells = {"time_s": [0.0, 1.0], "1": [0.0, 0.5], "2": [0.0, 0.25]}
    return Finished({**row(2, 20.0, 1, None), "key": key, **more}, cells)


def test_parts_and_tables_hold_the_same(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    results = claimed(tmp_path)
    results.add(finished("a", speed=2.0))
    results.add(finished("b", speed="max"))
    series = results.series()
    results.compact()
    assert not list(tmp_path.glob("parts/*"))
    assert results.series() == series
    assert [r["key"] for r in results.rows()] == ["a", "b"]
    # A part that was merged but not removed, as after kill -9, changes nothing.
    results.add(finished("b", speed="max"))
    results.add(finished("c"))
    assert results.done() == {"a", "b", "c"}
    results.compact()
    assert [r["key"] for r in results.rows()] == ["a", "b", "c"]
    assert results.series().keys() == {"a", "b", "c"}
    assert (tmp_path / "results.csv").read_text().count("\n") == 4


def test_an_unfinished_file_is_no_result(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    results = claimed(tmp_path)
    (tmp_path / "parts" / "a.json.part").write_text('{"row": {"ke')
    assert results.done() == set()


DAMAGED = {
    "cut off": '{"row": {"ke',
    "no part": '{"mine": 1}',
    "of another run": json.dumps({"row": {**row(2, 20.0, 1, None), "key": "b"}, "series": {}}),
    "a row without status": json.dumps({"row": {"key": "a"}, "series": {}}),
    "a series of words": json.dumps(
        {"row": {**row(2, 20.0, 1, None), "key": "a"}, "series": {"time_s": ["x"], "1": [0]}}
    ),
    "a series that is too short": json.dumps(
        {"row": {**row(2, 20.0, 1, None), "key": "a"}, "series": {"time_s": [0.0, 1.0], "1": [0.0]}}
    ),
    "a series without times": json.dumps({"row": {**row(2, 20.0, 1, None), "key": "a"}, "series": {"1": [0.0]}}),
}


@pytest.mark.parametrize("text", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_part_is_told_and_stays_until_its_run_is_done(
    text: str, tmp_path: Path, claimed: Callable[[Path], Results]
) -> None:
    results = claimed(tmp_path)
    part = tmp_path / "parts" / "a.json"
    part.write_text(text)
    results.add(finished("c"))
    assert results.damaged() == [part]
    assert results.done() == {"c"}
    results.compact()
    assert list(tmp_path.glob("parts/*")) == [part]
    assert part.read_text() == text
    results.add(finished("a"))
    assert results.damaged() == []
    results.compact()
    assert not list(tmp_path.glob("parts/*"))


def test_names_do_not_make_a_folder_a_studys(tmp_path: Path) -> None:
    for name in "parts", "scenarios":
        (tmp_path / name).mkdir()
    (tmp_path / "results.csv").write_text("mine")
    (tmp_path / "parts" / "a.json").write_text("mine")
    with pytest.raises(ClaimError, match="holds parts, which no study wrote"):
        Results(tmp_path).claim()
    assert (tmp_path / "results.csv").read_text() == (tmp_path / "parts" / "a.json").read_text() == "mine"
    assert not (tmp_path / "study.lock").exists()


def _table(**columns: list[object]) -> bytes:
    content = io.BytesIO()
    pq.write_table(pa.table(columns), content)
    return content.getvalue()


@pytest.mark.parametrize("name", ["results.parquet", "series.parquet"])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a whole Parquet table"),
        (b"PAR1", "not a whole Parquet table"),
        (_table(mine=[1]), "not a table of a study: column key"),
        (_table(key=[None], cell=["1"], variant=["a"]), "not a table of a study: column key"),
        (None, "a pipe or a device"),
    ],
)
def test_damaged_tables_are_one_line_before_anything_runs(
    name: str, content: bytes | None, words: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    with contextlib.closing(Results(tmp_path / "out")) as results:
        results.claim()
        results.add(finished("a"))
        results.compact()
    (tmp_path / "out" / name).unlink()
    if content is None:
        os.mkfifo(tmp_path / "out" / name)
    else:
        (tmp_path / "out" / name).write_bytes(content)
    study = str(tiny(tmp_path, 1, 5.0))
    asked = [["--out", str(tmp_path / "out")], ["--out", str(tmp_path / "out"), "--plot-only"]]
    if name == "results.parquet":
        asked.append(["--out", str(tmp_path / "new"), "--compare", str(tmp_path / "out")])
    for options in asked:
        assert main([study, *options]) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert name in told.err
        assert (told.out, told.err.count("\n")) == ("", 1)
    assert not (tmp_path / "new").exists()


def test_rows_without_their_series_are_told(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    results = claimed(tmp_path)
    for key, status in ("a", "searched"), ("b", "searched"), ("c", ERROR):
        results.add(finished(key, status=status))
    results.compact()
    results.check()
    (tmp_path / "series.parquet").unlink()
    with pytest.raises(ResultsError, match=r"series.parquet: lacks 2 of the runs"):
        results.check()


@pytest.mark.parametrize("status", STATUSES)
def test_every_status_has_one_meaning_everywhere(
    status: str, tmp_path: Path, claimed: Callable[[Path], Results]
) -> None:
    results = claimed(tmp_path)
    results.add(finished("a", status=status))
    has_result = status in ("searched", "time_limit", "exhausted")
    assert bool(usable(results.rows())) == has_result
    assert results.done() == {"a"}
    assert results.done(retry_failed=True) == ({"a"} if has_result else set())
    short = shortfall({"status": status, "simulated_s": 1.0, "why": None})
    assert (short is None) == (status in ("searched", "time_limit", "interrupted")), "exhausted before it was finished"


def test_every_status_of_the_world_is_in_the_list() -> None:
    """Each text that is assigned to a status."""
    told = set()
    for path in (ROOT / "world" / "core.py", ROOT / "world" / "process.py", ROOT / "deploy/processes/launcher.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Assign) and any("status" in ast.unparse(target) for target in node.targets):
                told |= {each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant)}
    words = {each for each in told if isinstance(each, str) and each.replace("_", "").isalpha()}
    assert {"searched", "time_limit", "no_robots", "interrupted"} <= words
    assert words <= STATUSES.keys()


def test_failed_runs_are_done_unless_asked_for_again(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    results = claimed(tmp_path)
    results.add(finished("a", status=ERROR, error="ValueError: no"))
    results.add(finished("b"))
    assert results.done() == {"a", "b"}
    assert results.done(retry_failed=True) == {"b"}


def test_differences_pass_over_wall_time_only() -> None:
    left = {**row(2, 20.0, 1, 100.0), "wall_s": 1.0, "tick_ms.p50": 1.0, "ticks": 5}
    assert differences([left], [{**left, "wall_s": 2.0, "tick_ms.p50": 9.0, "engine": "processes"}]) == []
    assert len(differences([left], [{**left, "ticks": 6}])) == 1


def test_a_row_names_its_variant_and_all_parameters(tmp_path: Path) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 5.0))))[0]
    found = pretend(point.key, point.variant, point.toml, "in-process", 1).row
    assert (found["variant"], found["seed"], found["rules.routing.sticky"]) == ("base", 1, True)
