"""Figures of studies, claims of the paper, and the pages of results."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.paper.claims import Verdict, fig6_claims, fig7_claims
from deploy.paper.results_page import unfinished, write_report
from deploy.run_folder.status import ERROR
from deploy.sweep.bounds import Bounds
from deploy.sweep.plan import Discard, Study, Variant, load_study, points_of, study_names
from deploy.sweep.plots import draw
from deploy.sweep.results import Results
from deploy.sweep.row import Finished
from tests.helpers.studies import rates, row

BOUNDS = Bounds(60.0, 8.0, 1 / 3.6, 0.8, {6: 11.5, 9: 11.5, 12: 5.5})
"""T_low is 187 s."""


def fig7_rows(slower_by: float = 1.0) -> list[dict[str, Any]]:
    """Results for which every claim holds; `slower_by` is a factor for all radii but the largest."""
    rows = []
    for robots in (6, 9, 12):
        for radius_m in (6.0, 12.0, 20.0, 25.0, 30.0, 50.0):
            for seed in (1, 2, 3):
                below = radius_m < BOUNDS.radio_m[robots]
                time_s = 200.0 + seed + max(0.0, 30.0 - radius_m) * 200.0 / robots
                time_s *= slower_by if radius_m < 50.0 else 1.0
                rows.append(row(robots, radius_m, seed, None if below else time_s))
    return rows


def fig6_table() -> tuple[list[dict[str, Any]], dict[str, dict[str, list[float]]]]:
    rows, series = [], {}
    for robots, first, second in ((6, None, None), (9, 656.0, 1281.0), (12, 341.0, 721.0)):
        for seed in (1, 2):
            ends = (0.2, 0.1) if first is None else (1.0, 1.0)
            found = {
                **row(robots, 9.0, seed, second), "search_time_s.1": first, "search_time_s.2": second,
                "search_rate.1": ends[0], "search_rate.2": ends[1],
            }  # fmt: skip
            rows.append(found)
            series[found["key"]] = rates([0.0, ends[0]], [0.0, ends[1]])
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


def words_of(verdicts: list[Verdict]) -> list[str]:
    return [verdict.word for verdict in verdicts]


def test_claims_hold_for_a_table_made_so() -> None:
    assert words_of(fig7_claims(fig7_rows(), BOUNDS)) == ["holds"] * 5
    rows, series = fig6_table()
    assert words_of(fig6_claims(rows, series, None)) == ["holds"] * 3


def test_claims_do_not_hold_for_the_opposite() -> None:
    turned = [{**r, "robots": 18 - r["robots"], "radius_m": 56.0 - r["radius_m"]} for r in fig7_rows()]
    assert {word for word in words_of(fig7_claims(turned, BOUNDS)) if word != "not measured"} == {"does not hold"}
    rows, series = fig6_table()
    turned = [{**r, "robots": 18 - r["robots"]} for r in rows]
    assert words_of(fig6_claims(turned, series, None)) == ["does not hold"] * 3


def changed(rows: list[dict[str, Any]], robots: int, radius_m: float, time_s: float | None) -> list[dict[str, Any]]:
    """The same results but for one point of the curves."""
    point = {"search_time_s.all": time_s, "status": "time_limit" if time_s is None else "searched"}
    return [{**r, **point} if (r["robots"], r["radius_m"]) == (robots, radius_m) else r for r in rows]


@pytest.mark.parametrize(
    ("which", "rows", "word"),
    [
        (0, changed(fig7_rows(), 6, 30.0, 226.0), "holds in part"),
        (0, changed(fig7_rows(), 6, 30.0, 224.0), "holds"),
        (0, changed(fig7_rows(), 6, 50.0, 226.0), "does not hold"),
        (0, changed(fig7_rows(), 6, 50.0, None), "does not hold"),
        (1, changed(fig7_rows(), 12, 12.0, 300.0), "holds in part"),
        (1, changed(fig7_rows(), 12, 6.0, 1100.0), "holds in part"),
        (1, changed(fig7_rows(), 12, 6.0, 150.0), "does not hold"),
        (2, changed(fig7_rows(), 6, 20.0, 250.0), "holds in part"),
        (2, [r for r in fig7_rows() if r["radius_m"] != 50.0 and r["robots"] != 12], "holds"),
        (3, changed(fig7_rows(), 6, 12.0, 1800.0), "holds"),
        (3, changed(fig7_rows(), 6, 12.0, 1900.0), "holds in part"),
        (3, fig7_rows(slower_by=9.0), "does not hold"),
        (4, changed(fig7_rows(), 9, 12.0, None), "holds in part"),
        (4, changed(fig7_rows(), 9, 6.0, 1000.0), "does not hold"),
    ],
)
def test_a_claim_on_fig7_holds_by_its_rule_alone(which: int, rows: list[dict[str, Any]], word: str) -> None:
    verdict = fig7_claims(rows, BOUNDS)[which]
    assert verdict.word == word, verdict.found
    assert "holds if" in verdict.rule


@pytest.mark.parametrize(
    ("which", "robots", "change", "word"),
    [
        (0, 12, {"search_time_s.1": 800.0}, "holds in part"),
        (0, 12, {"search_time_s.2": None}, "holds in part"),
        (1, 6, {"search_rate.2": 0.5}, "does not hold"),
        (1, 6, {"search_rate.2": 0.3}, "holds"),
        (1, 6, {"search_time_s.2": 1900.0}, "does not hold"),
        (2, 9, {"search_time_s.1": 341.0, "search_time_s.2": 400.0}, "holds in part"),
        (2, 9, {"search_time_s.1": 10.0, "search_time_s.2": 10.0}, "does not hold"),
    ],
)
def test_a_claim_on_fig6_holds_by_its_rule_alone(which: int, robots: int, change: dict[str, Any], word: str) -> None:
    """One of the two runs of a fleet is changed."""
    rows, series = fig6_table()
    rows = [{**r, **change} if (r["robots"], r["seed"]) == (robots, 1) else r for r in rows]
    verdict = fig6_claims(rows, series, None)[which]
    assert verdict.word == word, verdict.found


def test_a_claim_on_n_6_holds_in_part_if_only_the_kept_runs_bear_it_out() -> None:
    rows, series = fig6_table()
    other = {**rows[0], "key": "from cell 2", "search_rate.2": 0.9}
    series["from cell 2"] = rates([0.0, 0.0], [0.0, 0.9])
    verdict = fig6_claims([*rows, other], series, Discard("2", "1", 0.15))[1]
    assert verdict.word == "holds in part"
    assert "kept: 0 of 2" in verdict.found
    assert "all: 0 of 3" in verdict.found


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
    # N = 12 at 20 m: 200 + 2 + 10 * 200 / 12 = 369 s in the middle, and all are within a second of it.
    assert "| 12 | 20 | 3 of 3 | 369 (368 to 370) |" in text
    assert "| 6 | 6 | 0 of 3 | 2000 |" in text
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
    assert "| 9 | 20 | 0.50 (0.50 to 0.50) | 0.75 (0.75 to 0.75) | 50% |" in text


def test_a_page_is_written_again_from_the_tables_beside_it(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
    studies, docs = tmp_path / "studies", tmp_path / "docs"
    rows, series = fig6_table()
    for name, found in (("fig7", as_planned("fig7", fig7_rows())), ("fig6", as_planned("fig6", rows))):
        results = claimed(studies / name)
        for old, new in zip(rows if name == "fig6" else found, found, strict=True):
            results.add(Finished(new, series.get(old["key"], {})))
        results.compact()
        results.note({"command": f"deploy/study.py {name}", "wall_s": 120.0, "machine": "one"})
    write_report(studies, docs)
    page = (docs / "results.md").read_text()
    assert "2 kept" in page
    elsewhere = tmp_path / "nothing"
    assert unfinished(elsewhere, docs) == []
    write_report(elsewhere, docs)
    assert (docs / "results.md").read_text() == page
    assert (docs / "results" / "fig7.png").read_bytes()[:4] == b"\x89PNG"
    (docs / "results" / "fig6.series.parquet").unlink()
    write_report(elsewhere, docs)
    assert "The time series of 6 of these runs were not kept" in (docs / "results.md").read_text()
    (docs / "results" / "fig7.csv").unlink()
    assert unfinished(elsewhere, docs) == ["fig7"]
