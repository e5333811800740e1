"""Figures of studies, claims of the paper, and the pages of results."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.paper.claims import fig6_claims, fig7_claims
from deploy.paper.results_page import write_report
from deploy.run_folder.status import ERROR
from deploy.sweep.bounds import Bounds
from deploy.sweep.plan import Study, Variant, load_study, points_of, study_names
from deploy.sweep.plots import draw
from deploy.sweep.results import Results
from deploy.sweep.row import Finished
from tests.helpers.studies import rates, row

BOUNDS = Bounds(60.0, 8.0, 1 / 3.6, 0.8)


def fig7_rows() -> list[dict[str, Any]]:
    """Results for which every claim holds."""
    rows = []
    for robots in (6, 9, 12):
        for radius_m in (6.0, 12.0, 20.0, 25.0, 35.0, 50.0):
            for seed in (1, 2, 3):
                below = radius_m < BOUNDS.r_low_m(robots)
                time_s = 225.0 + seed + max(0.0, 30.0 - radius_m) * 300.0 / robots
                rows.append(row(robots, radius_m, seed, None if below else time_s))
    return rows


def fig6_table() -> tuple[list[dict[str, Any]], dict[str, dict[str, list[float]]]]:
    rows, series = [], {}
    for robots, first, second in ((6, None, None), (9, 456.0, 881.0), (12, 341.0, 721.0)):
        for seed in (1, 2):
            found = {**row(robots, 9.0, seed, second), "search_time_s.1": first, "search_time_s.2": second}
            rows.append(found)
            series[found["key"]] = rates([0.0, 0.3 if first is None else 1.0], [0.0, 0.1 if first is None else 1.0])
    return rows, series


def a_study(plot: Any, variants: tuple[str, ...] = ()) -> Study:
    return Study("picture", "three_cells", plot, variant=tuple(map(Variant, variants)))


@pytest.mark.parametrize("plot", ["search_rate", "search_time", "variants"])
def test_pictures_are_drawn_the_same_every_time(tmp_path: Path, plot: str) -> None:
    rows, series = fig6_table() if plot == "search_rate" else (fig7_rows(), {})
    study, first = a_study(plot), tmp_path / "1"
    first.mkdir()
    png, svg = draw(study, rows, series, BOUNDS, first)
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    again = draw(study, rows, series, BOUNDS, tmp_path)
    assert again[1].read_bytes() == svg.read_bytes()


def test_any_title_and_any_number_of_cells_can_be_drawn(tmp_path: Path) -> None:
    odd = "costs $\\frac$ and _more_ ^"
    rows, _ = fig6_table()
    series = {found["key"]: {"time_s": [0.0], **{f"{odd} {i}": [0.5] for i in range(9)}} for found in rows}
    for plot in "search_rate", "variants":
        found = [{**each, "variant": odd} for each in rows]
        study = dataclasses.replace(a_study(plot, (odd,)), title=odd)
        _, svg = draw(study, found, series, BOUNDS, tmp_path)
        assert svg.read_text().count("costs $\\frac$ and _more_ ^") >= 2


def test_fig7_marks_points_that_not_all_runs_finished(tmp_path: Path) -> None:
    rows = [row(6, 20.0, 1, 900.0), row(6, 20.0, 2, None), row(6, 8.0, 1, None), row(6, 30.0, 1, 300.0)]
    whole = draw(a_study("search_time"), [rows[0], rows[3]], {}, BOUNDS, tmp_path)[1].read_text().count("<path")
    svg = draw(a_study("search_time"), rows, {}, BOUNDS, tmp_path)[1].read_text()
    assert "1/2" in svg
    assert "1/1" not in svg
    assert svg.count("<path") > whole


def test_a_failed_run_is_no_point_of_a_figure(tmp_path: Path) -> None:
    rows = [row(6, 20.0, 1, 900.0), {**row(6, 20.0, 2, None), "status": ERROR}]
    svg = draw(a_study("search_time"), rows, {}, BOUNDS, tmp_path)[1].read_text()
    assert "1/2" not in svg


def test_claims_hold_for_a_table_made_so() -> None:
    assert [verdict.word for verdict in fig7_claims(fig7_rows(), BOUNDS)] == ["holds"] * 5
    rows, series = fig6_table()
    assert [verdict.word for verdict in fig6_claims(rows, series, None)] == ["holds"] * 3


def test_claims_do_not_hold_for_the_opposite() -> None:
    turned = [{**r, "robots": 18 - r["robots"], "radius_m": 56.0 - r["radius_m"]} for r in fig7_rows()]
    assert not any(verdict.holds for verdict in fig7_claims(turned, BOUNDS)[:4])
    below = [row(6, 6.0, 1, 1000.0)]
    assert fig7_claims(below, BOUNDS)[4].holds is False
    rows, series = fig6_table()
    turned = [{**r, "robots": 18 - r["robots"]} for r in rows]
    assert [verdict.holds for verdict in fig6_claims(turned, series, None)] == [False, False, False]


def test_claims_without_results_are_not_measured() -> None:
    assert {verdict.word for verdict in fig7_claims([], BOUNDS) + fig6_claims([], {}, None)} == {"not measured"}


def as_planned(name: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Synthetic rows with the keys of a study's runs; the report leaves others out."""
    runs = [(point, tomllib.loads(point.toml)) for point in points_of(load_study(name))]
    keys = {(point.variant, run["robots"], run["radius_m"], run["seed"]): point.key for point, run in runs}
    return [{**r, "key": keys[r["variant"], r["robots"], r["radius_m"], r["seed"]]} for r in rows]


def test_the_report_takes_its_numbers_from_the_tables(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    studies, docs = tmp_path / "studies", tmp_path / "docs"
    pages = write_report(studies, docs)
    assert [page.name for page in pages] == ["results.md", "policies.md"]
    assert sum(page.read_text().count("Not measured yet") for page in pages) == len(study_names()) - 1, (
        "buildings has a page of its own"
    )
    results = claimed(studies / "fig7")
    for found in as_planned("fig7", fig7_rows()):
        results.add(Finished(found, {}))
    superseded = {**row(12, 20.0, 11, 9999.0), "key": "of-a-former-plan"}
    results.add(Finished(superseded, {}))
    results.compact()
    results.note({"command": "deploy/study.py fig7", "wall_s": 120.0, "machine": "one"})
    table = (studies / "fig7" / "results.csv").read_text()
    write_report(studies, docs)
    assert (studies / "fig7" / "results.csv").read_text() == table
    text = (docs / "results.md").read_text()
    # N = 12 at 20 m: 225 + 2 + 10 * 300 / 12 = 477 s in the middle, against 393 s of the prototype.
    assert "| 12 | 20 | 3 of 3 | 477 ± 1 | 477 ± 2 | 393 ± 117 | 1.21 | yes |" in text
    assert "by `deploy/study.py fig7` in 2 minutes on one" in text
    assert (docs / "results" / "fig7.csv").exists()


def test_the_page_of_policies_shows_both_ratios_and_what_walking_faster_has_of_the_gain(
    tmp_path: Path, claimed: Callable[[Path], Results]
) -> None:
    results = claimed(tmp_path / "studies" / "policies")
    means_s = {"vds": 400.0, "scout": 200.0, "scout at 1 km/h": 300.0}
    rows = [row(9, 20.0, seed, time_s, variant=v) for v, time_s in means_s.items() for seed in (1, 2)]
    for found in as_planned("policies", rows):
        results.add(Finished(found, {}))
    results.compact()
    write_report(tmp_path / "studies", tmp_path / "docs")
    text = (tmp_path / "docs" / "policies.md").read_text()
    assert "| 9 | 20 | 0.50 ± 0.00 | 0.75 ± 0.00 | 50% |" in text
