"""The results of a study on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from deploy.sweep.plan import load_study, points_of
from deploy.sweep.results import Results, differences
from deploy.sweep.row import ERROR, Finished
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
