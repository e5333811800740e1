"""Studies: their plan, their results on disk, their execution, their figures and their report."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import signal
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pytest

from deploy.paper.claims import fig6_claims, fig7_claims
from deploy.paper.results_page import write_report
from deploy.scenario import ScenarioError, load
from deploy.study import main
from deploy.sweep.bounds import Bounds, bounds_of
from deploy.sweep.plan import Discard, Point, Study, Variant, load_study, points_of, study_names
from deploy.sweep.plots import draw
from deploy.sweep.results import Results, differences
from deploy.sweep.row import ERROR, Finished, run_point
from deploy.sweep.statistics import estimate, goes_first, kept, mean_rates, ratio
from deploy.sweep.workers import Execution, LocalPool
from tests.helpers.studies import command, tiny
from tests.helpers.study_workers import die_once_told, pretend
from tests.helpers.waiting import alive, wait_until

BOUNDS = Bounds(60.0, 8.0, 1 / 3.6, 0.8)


Claimed = Callable[[Path], Results]


@pytest.fixture
def claimed() -> Iterator[Claimed]:
    with contextlib.ExitStack() as held:

        def claim(folder: Path) -> Results:
            results = held.enter_context(contextlib.closing(Results(folder)))
            results.claim()
            return results

        yield claim


def row(robots: int, radius_m: float, seed: int, time_s: float | None, **more: Any) -> dict[str, Any]:
    """A row of a synthetic table."""
    status = "time_limit" if time_s is None else "searched"
    return {
        "key": f"{robots}-{radius_m}-{seed}-{more.get('variant', 'base')}", "variant": "base", "engine": "in-process",
        "scenario": "synthetic", "seed": seed, "robots": robots, "radius_m": radius_m, "status": status,
        "error": None, "duration_s": 2000.0, "connected_fraction": 0.9, "search_time_s.all": time_s,
        "search_time_s.1": time_s, "search_time_s.2": time_s, **more,
    }  # fmt: skip


class Threads:
    """Workers without processes."""

    at_once: int | None = 2

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(2)

    @property
    def executor(self) -> Executor:
        return self._executor

    def renew(self) -> None:
        raise AssertionError("no worker was lost")

    def close(self) -> None:
        self._executor.shutdown()


@pytest.fixture
def pool() -> Iterator[LocalPool]:
    workers = LocalPool(2)
    yield workers
    workers.close()


# The plan


def test_axes_cross_and_variants_override(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text("""
scenario = "three_cells"
plot = "search_time"
[set]
rules.routing.sticky = false
[axes]
robots = [2, 3]
radius_m = [10.0, 20.0]
seed = "1..3"
fault = ["", "kill:1@5"]
[[variant]]
name = "as set"
[[variant]]
name = "sticky"
set.rules.routing.sticky = true
""")
    points = points_of(load_study(str(path)))
    assert len({point.key for point in points}) == 2 * 2 * 3 * 2 * 2
    assert sum("sticky = true" in point.toml for point in points) == 24
    assert all(("sticky = true" in point.toml) == (point.variant == "sticky") for point in points)
    assert sum(bool(tomllib.loads(point.toml).get("fault")) for point in points) == 24
    efforts = [point.effort for point in points]
    assert efforts == sorted(efforts, reverse=True)


def test_a_stored_scenario_is_the_very_run(tmp_path: Path, claimed: Claimed) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 5.0))))[0]
    results = claimed(tmp_path / "out")
    results.plan([point])
    assert load(results.scenario_path(point.key)).to_toml() == point.toml


@functools.cache
def shipped(name: str) -> list[Point]:
    return points_of(load_study(name))


@pytest.mark.parametrize("name", study_names())
def test_every_shipped_study_fits_together(name: str) -> None:
    whole, quick = shipped(name), points_of(load_study(name, quick=True))
    assert 0 < len(quick) < len(whole)


def test_the_figures_cover_what_was_asked_for() -> None:
    fig6, fig7 = shipped("fig6"), shipped("fig7")
    assert len(fig6) >= 3 * 30
    assert len(fig7) >= 3 * 13 * 10
    assert all("store_and_forward = false" in point.toml for point in fig6 + fig7)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("plott = 'x'", "did you mean 'plot'"),
        ("[axes]\nradius_m = [1.0]\nrobotss = [1]", "did you mean 'robots'"),
        ("[axes]\nradius_m = [1.0]\nseed = '9..1'", "expected a list"),
        ("[axes]\nradius_m = [-1.0]", "radius_m"),
        ("[axes]\nseed = '1..2'", "needs an axis radius_m"),
        ("[axes]\nradius_m = [1.0]\n[[variant]]\nname='a'\n[[variant]]\nname='a'", "twice"),
        ("[axes]\nradius_m = [1.0]\n[[variant]]\nname='a'\nsets={}", "did you mean 'set'"),
        ("this is not TOML", "not TOML"),
    ],
)
def test_a_wrong_study_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(f"scenario = 'three_cells'\nplot = 'search_time'\n{text}\n")
    with pytest.raises(ScenarioError) as caught:
        points_of(load_study(str(path)))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# Results on disk


def finished(key: str, **more: Any) -> Finished:
    cells = {"time_s": [0.0, 1.0], "1": [0.0, 0.5], "2": [0.0, 0.25]}
    return Finished({**row(2, 20.0, 1, None), "key": key, **more}, cells)


def test_parts_and_tables_hold_the_same(tmp_path: Path, claimed: Claimed) -> None:
    results = claimed(tmp_path)
    results.add(finished("a", speed=2.0))
    results.add(finished("b", speed="max"))
    series = results.series()
    results.compact()
    assert not list(tmp_path.glob("parts/*"))
    assert results.series() == series
    assert [r["key"] for r in results.rows()] == ["a", "b"]
    # A part that was merged already, as after an end between merging and removing, changes nothing.
    results.add(finished("b", speed="max"))
    results.add(finished("c"))
    assert results.done() == {"a", "b", "c"}
    results.compact()
    assert [r["key"] for r in results.rows()] == ["a", "b", "c"]
    assert results.series().keys() == {"a", "b", "c"}
    assert (tmp_path / "results.csv").read_text().count("\n") == 4


def test_an_unfinished_file_is_no_result(tmp_path: Path, claimed: Claimed) -> None:
    results = claimed(tmp_path)
    (tmp_path / "parts" / "a.json.part").write_text('{"row": {"ke')
    assert results.done() == set()


def test_failed_runs_are_done_unless_asked_for_again(tmp_path: Path, claimed: Claimed) -> None:
    results = claimed(tmp_path)
    results.add(finished("a", status=ERROR, error="ValueError: no"))
    results.add(finished("b"))
    assert results.done() == {"a", "b"}
    assert results.done(retry_failed=True) == {"b"}


def test_differences_pass_over_wall_time_only() -> None:
    left = {**row(2, 20.0, 1, 100.0), "wall_s": 1.0, "tick_ms.p50": 1.0, "ticks": 5}
    assert differences([left], [{**left, "wall_s": 2.0, "tick_ms.p50": 9.0, "engine": "processes"}]) == []
    assert len(differences([left], [{**left, "ticks": 6}])) == 1


# Execution


def test_only_what_is_missing_is_run(tmp_path: Path, claimed: Claimed) -> None:
    points = points_of(load_study(str(tiny(tmp_path, 5, 5.0))))
    results = claimed(tmp_path / "out")
    workers = Threads()
    for _, run in Execution(workers, "in-process", 1, pretend).results(points[:3]):
        results.add(run)
    todo = [point for point in points if point.key not in results.done()]
    assert todo == points[3:]
    workers.close()


def test_a_run_that_raises_is_a_row_with_its_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = points_of(load_study(str(tiny(tmp_path, 1, 2.0))))[0]
    bad = dataclasses.replace(good, key="bad", toml=good.toml.replace("robots = 2", "robots = 0"))
    workers = Threads()
    rows = {point.key: run.row for point, run in Execution(workers, "in-process", 1).results([bad, good])}
    workers.close()
    assert rows["bad"]["status"] == ERROR
    assert "robots" in rows["bad"]["error"]
    assert rows[good.key]["status"] == "time_limit"
    assert rows[good.key]["ticks"] == 20
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.processes
def test_a_worker_that_dies_costs_its_own_run_only(tmp_path: Path, pool: LocalPool) -> None:
    points = points_of(load_study(str(tiny(tmp_path, 4, 5.0))))
    execution = Execution(pool, "in-process", 1, die_once_told)
    rows = {run.row["seed"]: run.row for _, run in execution.results(points)}
    assert {seed: found["status"] for seed, found in rows.items()} == {
        1: "searched", 2: ERROR, 3: "searched", 4: "searched",
    }  # fmt: skip
    assert "worker process died" in rows[2]["error"]


def stopped_by(number: signal.Signals, ask: list[str], parts: Path, workers_end_within_s: float = 10) -> int:
    """Stop a study after its next result; returns its exit status once its workers are gone too."""
    before = len(list(parts.glob("*.json")))
    with subprocess.Popen(ask, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as study:
        wait_until(lambda: len(list(parts.glob("*.json"))) > before, 60, "one more result")
        workers = [child.pid for child in psutil.Process(study.pid).children(recursive=True)]
        study.send_signal(number)
        status = study.wait(30)
    wait_until(lambda: not any(map(alive, workers)), workers_end_within_s, "the workers end with the study")
    return status


@pytest.mark.processes
def test_an_end_by_force_or_by_request_loses_only_what_was_running(tmp_path: Path) -> None:
    path, out = tiny(tmp_path, 6, 40.0), tmp_path / "out"
    ask = command(path, "--out", out, "--workers", 1)
    assert stopped_by(signal.SIGKILL, ask, out / "parts") == -signal.SIGKILL
    assert stopped_by(signal.SIGTERM, ask, out / "parts") == 130
    assert (out / "results.parquet").exists()
    before = len(Results(out).rows())
    assert before >= 2
    again = subprocess.run(ask, capture_output=True, text=True, timeout=120, check=True)
    assert f"6 runs, {before} of them done" in again.stdout
    assert len(Results(out).rows()) == 6
    assert (out / "tiny.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fig8"], "did you mean 'fig7'"),
        (["fig7", "--workers", "0"], "--workers 0"),
        (["nowhere/none.toml"], "No such file"),
        (["fig7", "fig6", "--out", "x"], "--out takes one study"),
        (["fig7", "report"], "report stands alone"),
        (["fig7", "--compare", "nowhere"], "no results.parquet"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("study.py: ")
    assert said.count("\n") == 1
    assert words in said


@pytest.mark.processes
def test_real_processes_give_the_same_row(tmp_path: Path) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 10.0))))[0]
    ours = run_point(point.key, point.variant, point.toml, "in-process", 1)
    theirs = run_point(point.key, point.variant, point.toml, "processes", 1)
    assert theirs.row["engine"] == "processes"
    assert differences([ours.row], [theirs.row]) == []


# Statistics


def test_the_confidence_interval_is_students() -> None:
    found = estimate([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found.mean == 3.0
    # t(0.975, 4) = 2.7764, s = sqrt(2.5)
    assert found.half_width == pytest.approx(2.77645 * math.sqrt(2.5) / math.sqrt(5), rel=1e-5)
    assert estimate([]).n == 0
    # Twice as much in every run is certain; what varies with the runs alone does not widen the interval.
    assert (ratio([(2.0, 1.0), (6.0, 3.0)]).mean, ratio([(2.0, 1.0), (6.0, 3.0)]).half_width) == (2.0, 0.0)
    unlike = ratio([(1.0, 1.0), (1.0, 3.0), (4.0, 2.0)])
    assert unlike.mean == 1.0
    assert unlike.half_width == pytest.approx(4.303 * 2.0 / math.sqrt(3.0) / 2.0, rel=1e-3)
    assert math.isnan(estimate([7.0]).half_width)


def test_the_bounds_are_those_of_the_arena() -> None:
    bounds = bounds_of(load("three_cells"))
    # The reading of Fig. 5 gives 61.2 m for the far corner of cell 2, and r_low 9.4, 6.6 and 5.1 m.
    assert bounds.farthest_m == pytest.approx(61.2, abs=1.0)
    assert [bounds.r_low_m(n) for n in (6, 9, 12)] == pytest.approx([9.4, 6.6, 5.1], abs=0.1)
    assert bounds.t_low_s == pytest.approx((189.0, 229.0), abs=3.0)


RULE = Discard("2", "1", 0.1)


def rates(first: list[float], second: list[float]) -> dict[str, list[float]]:
    return {"time_s": [float(i) for i in range(len(first))], "1": first, "2": second}


@pytest.mark.parametrize(
    ("times", "series", "first"),
    [
        ((100.0, 200.0), rates([0.0, 0.0], [0.5, 0.5]), "1"),
        ((300.0, 200.0), rates([0.5, 0.5], [0.0, 0.0]), "2"),
        ((None, 200.0), rates([0.5, 0.5], [0.0, 0.0]), "2"),
        ((None, None), rates([0.0, 0.2], [0.0, 0.0]), "1"),
        ((None, None), rates([0.0, 0.2], [0.1, 0.1]), "2"),
        ((None, None), rates([0.0, 0.05], [0.0, 0.09]), None),
    ],
)
def test_which_cell_a_run_searched_first(
    times: tuple[float | None, float | None], series: dict[str, list[float]], first: str | None
) -> None:
    found = {**row(6, 9.0, 1, None), "search_time_s.1": times[0], "search_time_s.2": times[1]}
    assert goes_first(found, series, RULE) == first
    assert len(kept([found], {found["key"]: series}, RULE)) == (first != "2")
    assert len(kept([found], {found["key"]: series}, None)) == 1


def test_a_run_that_ended_keeps_its_rate() -> None:
    band = mean_rates([rates([0.0, 1.0], [0.0, 0.0]), rates([0.0, 0.0, 0.0], [0.0] * 3)], "1", 5.0)
    assert band.mean.tolist() == [0.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert band.low.min() >= 0.0
    assert band.high.max() <= 1.0
    assert band.n == 2


# Figures, claims, report


def fig7_rows() -> list[dict[str, Any]]:
    """A table that bears out every claim."""
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
    """Rows of a synthetic table with the keys that a study gives such runs; the report leaves others out."""
    runs = [(point, tomllib.loads(point.toml)) for point in points_of(load_study(name))]
    keys = {(point.variant, run["robots"], run["radius_m"], run["seed"]): point.key for point, run in runs}
    return [{**r, "key": keys[r["variant"], r["robots"], r["radius_m"], r["seed"]]} for r in rows]


def test_the_report_takes_its_numbers_from_the_tables(tmp_path: Path, claimed: Claimed) -> None:
    studies, docs = tmp_path / "studies", tmp_path / "docs"
    pages = write_report(studies, docs)
    assert [page.name for page in pages] == ["results.md", "policies.md"]
    assert sum(page.read_text().count("Not measured yet") for page in pages) == len(study_names())
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
    tmp_path: Path, claimed: Claimed
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


def test_an_axis_of_tables_varies_keys_together_and_a_variant_may_have_its_own_axes(tmp_path: Path) -> None:
    path = tmp_path / "pairs.toml"
    path.write_text(
        'scenario = "three_cells"\nplot = "variants"\n[axes]\nseed = "1..3"\n'
        "fleet = [{robots = 6, radius_m = 12.0}, {robots = 9, radius_m = 20.0}]\n"
        '[[variant]]\nname = "all"\n[[variant]]\nname = "one seed"\naxes.seed = [7]\n'
    )
    runs = [(point.variant, tomllib.loads(point.toml)) for point in points_of(load_study(str(path)))]
    found = sorted((variant, run["robots"], run["radius_m"], run["seed"]) for variant, run in runs)
    pairs = [(6, 12.0), (9, 20.0)]
    assert found == sorted(
        [("all", *pair, seed) for pair in pairs for seed in (1, 2, 3)] + [("one seed", *pair, 7) for pair in pairs]
    )


def test_a_row_names_its_variant_and_all_parameters(tmp_path: Path) -> None:
    point = points_of(load_study(str(tiny(tmp_path, 1, 5.0))))[0]
    found = pretend(point.key, point.variant, point.toml, "in-process", 1).row
    assert (found["variant"], found["seed"], found["rules.routing.sticky"]) == ("base", 1, True)
