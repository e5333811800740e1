"""The study of buildings: its table, what it claims, and its page."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deploy.buildings.claims import ASKED, SEEDS, buildings_claims, time_s
from deploy.buildings.page import page_of, write_buildings
from deploy.buildings.table import COLUMNS, Cell, cells_of, merged, read_table, write_table
from deploy.scenario import load
from deploy.sweep.lower_bound import lower_bound
from deploy.sweep.plan import load_study, points_of, runs_of
from deploy.sweep.results import Results, ResultsError
from deploy.sweep.row import Finished
from tests import ROOT
from world.own_file import ForeignFileError

STUDY = load_study("buildings")


def mission(variant: str, building: str, seed: int, t100_s: float | None, **more: Any) -> dict[str, Any]:
    """A row as the table has it; half of the floor is known at a tenth of the time."""
    end_s = 3000.0 if t100_s is None else t100_s
    numbers = dict.fromkeys(COLUMNS, 1.0)
    return numbers | {
        "variant": variant, "scenario": building, "policy": variant.partition(",")[0], "status": "searched",
        "code": "abc", "trace_sha256": "ff", "seed": float(seed), "robots": 12.0, "duration_s": 3000.0,
        "known_free.t50_s": end_s / 10, "known_free.t90_s": end_s / 2, "known_free.t100_s": t100_s,
        "map_errors.free_called_wall": 0.001, "connected_fraction": 0.9, "walked_m": 2500.0, "wall_s": 90.0,
        "scan_reports.buffered": 3.0, "bound.walk_s": 100.0, "bound.sweep_s": 40.0, "bound.chain": 5.0,
    } | more  # fmt: skip


def as_asked() -> list[dict[str, Any]]:
    """Rows with which every claim holds."""
    times = {"scout, walls block": 1300.0, "sortie, walls block, bodies": 700.0}
    return [
        mission(variant, building, seed, times.get(variant, 600.0) + seed)
        for variant, buildings in ASKED.items()
        for building in buildings
        for seed in range(1, SEEDS + 1)
    ]


def test_the_study_is_as_large_as_it_may_be_and_has_what_the_claims_need() -> None:
    cells = cells_of(STUDY)
    assert runs_of(STUDY) == sum(cell.seeds for cell in cells) <= 1000
    planned = {(cell.variant, cell.scenario): cell.seeds for cell in cells}
    assert len(planned) == len(cells)
    assert {planned[variant, building] for variant, found in ASKED.items() for building in found} == {SEEDS}
    names = {load(building["scenario"]).name for building in STUDY.axes["building"] if "/" not in building["scenario"]}
    assert names == {"hospital_ward", "warehouse", "office_20_rooms", "tunnels", "cluttered_room"}


def test_every_claim_holds_for_rows_made_so_and_none_for_the_opposite() -> None:
    assert {verdict.holds for verdict in buildings_claims(as_asked())} == {True}
    slow = {"sortie, walls block": 1000.0, "sortie, walls block, bodies": 2000.0, "scout, disk": 300.0}
    turned = [
        row | {
            "known_free.t100_s": None if row["seed"] <= 2 else slow.get(row["variant"], 900.0),
            "map_errors.free_called_wall": 0.006, "scan_reports.buffered": 13.0,
        }
        for row in as_asked()
    ]  # fmt: skip
    assert {verdict.holds for verdict in buildings_claims(turned)} == {False}
    assert {verdict.holds for verdict in buildings_claims([])} == {None}


def test_a_claim_is_open_until_its_seeds_are_run_or_decide_it() -> None:
    case = "sortie, walls block, bodies", "tunnels"
    rows = [mission(*case, seed, 500.0) for seed in range(1, 6)]

    def verdict(rows: list[dict[str, Any]]) -> tuple[str, bool | None]:
        (found,) = (
            v for v in buildings_claims(rows) if v.claim == "`tunnels`, sortie, walls block, bodies: 9 of 10 finish"
        )
        return found.found, found.holds

    assert verdict(rows) == ("5 of 5", None)
    rows[2]["known_free.t100_s"] = None
    assert verdict(rows) == ("4 of 5; not seed 3", None), "one of ten may fail"
    rows[4]["known_free.t100_s"] = None
    assert verdict(rows) == ("3 of 5; not seed 3, 5", False)


def test_a_mission_that_does_not_get_there_counts_with_its_limit() -> None:
    row = mission("scout, disk", "hospital_025", 1, None)
    assert (time_s(row), time_s(row, "known_free.t50_s")) == (3000.0, 300.0)


def test_the_page_shows_medians_beside_the_bound_and_what_has_not_been_run() -> None:
    cells = [Cell("sortie, disk", "hall", 10), Cell("scout, disk", "hall", 10), Cell("vds, disk", "hall", 10)]
    rows = [mission("sortie, disk", "hall", seed, 300.0 + 100 * seed) for seed in (1, 2, 3)]
    rows += [mission("scout, disk", "hall", 1, 900.0, **{"information_age.p95_s": None, "bound.chain": None})]
    text = page_of(cells, rows)
    assert "4 of 30 missions, in 0.1 hours" in text
    assert "| sortie, disk | 3 of 10 |" in text
    assert "| vds, disk | 0 of 10 |" in text
    (sortie,) = (line for line in text.splitlines() if line.startswith("| `hall` | sortie |"))
    # The median of 400, 500 and 600 s; the gap to the bound of 100 s is half of that of scout, 800 s.
    assert sortie.startswith("| `hall` | sortie | 3 of 3 [44%, 100%] | 50 [40, 60] | 250 [200, 300] | 500 [400, 600] |")
    assert "| **100**: 100, 40 | 5 | 0.50 | 90.0% | 1 | 1.0, 1.0 | 2.5 |" in sortie
    (scout,) = (line for line in text.splitlines() if line.startswith("| `hall` | scout |"))
    assert "| 90 | 450 | 900 | **100**: 100, 40 | none | 1.00 | 90.0% | 1 | 1.0, never | 2.5 |" in scout
    assert "`hall` | vds" not in text
    late = page_of(cells, [mission("scout, disk", "hall", 1, None), *rows[:3]])
    assert "| 300 | 1500 | > 3000 |" in late
    assert "| 5 | - | 90.0% |" in late, "of a mission that did not finish the gap is not known"


def test_the_table_outlives_the_results_and_gives_the_same_page(
    tmp_path: Path, claimed: Callable[[Path], Results]
) -> None:
    (point,) = (
        p
        for p in points_of(STUDY)
        if p.variant == "sortie, 18 dB" and 'name = "cluttered_room"' in p.toml and "\nseed = 3\n" in p.toml
    )
    docs, studies = tmp_path / "docs", tmp_path / "studies"
    (docs / "results").mkdir(parents=True)
    earlier = [
        mission("sortie, 18 dB", "cluttered_room", 3, 1.0),
        mission("sortie, 18 dB", "cluttered_room", 2, 2.0),
        mission("of a former plan", "cluttered_room", 2, 2.0),
    ]
    write_table(docs / "results" / "buildings.csv", earlier)
    results = claimed(studies / "buildings")
    results.plan([point])
    row = mission("sortie, 18 dB", "cluttered_room", 3, 700.0) | {"key": point.key, "seed": 3, "robots": 12}
    results.add(Finished(row, {"time_s": [0.0], "all": [0.5]}))
    table, page = write_buildings(studies, docs)
    kept = read_table(table)
    assert [(found["seed"], found["known_free.t100_s"]) for found in kept] == [(2.0, 2.0), (3.0, 700.0)]
    bound = lower_bound(load(results.scenario_path(point.key)))
    assert kept[1]["bound.walk_s"] == pytest.approx(bound.walk_s, rel=1e-5)
    assert kept[1]["bound.chain"] == bound.chain
    written = table.read_bytes(), page.read_bytes()
    shutil.rmtree(studies)
    write_buildings(studies, docs)
    assert (table.read_bytes(), page.read_bytes()) == written


def test_what_is_no_table_is_refused_in_one_line(tmp_path: Path) -> None:
    table = tmp_path / "buildings.csv"
    assert read_table(table) == []
    for text in ("a,b\n1,2\n", f"{','.join(COLUMNS)}\nx\n", f"{','.join(COLUMNS)}\n{',' * (len(COLUMNS) - 1)}\n"):
        table.write_text(text)
        with pytest.raises(ResultsError, match="not the table of the study") as caught:
            read_table(table)
        assert "\n" not in str(caught.value)
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "buildings.md").write_text("mine\n")
    with pytest.raises(ForeignFileError):
        write_buildings(tmp_path, docs)
    assert not (docs / "results").exists()


def test_the_page_that_ships_is_that_of_its_table() -> None:
    rows = read_table(ROOT / "docs" / "results" / "buildings.csv")
    assert (ROOT / "docs" / "buildings.md").read_text(encoding="utf-8") == page_of(cells_of(STUDY), rows)
    assert merged(STUDY, rows, ROOT / "nowhere") == rows
