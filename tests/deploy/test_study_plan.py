"""Studies: which runs they have, and one line for every one that is wrong."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy.scenario import ScenarioError, load
from deploy.sweep.campaign import sample, select
from deploy.sweep.plan import Point, absent, load_study, points_of, study_names
from deploy.sweep.results import Results
from tests.helpers.studies import tiny


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


def test_a_stored_scenario_is_the_very_run(tmp_path: Path, claimed: Callable[[Path], Results]) -> None:
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
        ("[axes]\nradius_m = [1.0]\nseed = '1..0'", "axes.seed = '1..0': expected a range from a low number"),
        ("[axes]\nradius_m = [1.0]\nseed = []", "axes.seed = []: expected a list"),
        ("[axes]\nradius_m = [1.0]\nseed = '\u0661..\u0662'", "expected a list"),
        (
            "[axes]\nradius_m = [1.0]\nseed = '1..9999'\nrobots = '1..999'\nduration_s = '1..9999'",
            "up to 10,000 are possible",
        ),
        ("[axes]\nradius_m = [1.0]\n[quick]\nseed = '1..9999'\nrobots = '1..999'", "up to 10,000 are possible"),
        ("[axes]\nradius_m = [1.0]\n[[variant]]\nname='a'\naxes.seed='1..9999'\naxes.robots='1..999'", "up to 10,000"),
        ("axes = 7", "axes = 7: should be a table"),
        ("variant = 7", "variant = 7: should be a list"),
        ("[axes]\nradius_m = [1.0]\n[[variant]]\nname = 7", "variant[1].name = 7: should be a valid string"),
        ("series_step_s = '2'", "series_step_s = '2': should be a valid integer"),
        ("discard = 7", "discard = 7: should be a table"),
        (
            "[axes]\nradius_m = [20.0]\n[discard]\ncell = '1'\nbefore = '4'",
            "discard.before = '4': scenario three_cells has no",
        ),
        ("[axes]\nradius_m = [20.0]\n[discard]\ncell = 'x'\nbefore = '1'", "discard.cell = 'x'"),
        (
            "[axes]\nradius_m = [1.0]\n[[variant]]\nname='a'\nagainst='zzz'",
            "variant 'a': against = 'zzz': no such variant",
        ),
        ('[axes]\nradius_m = [1.0]\n[[variant]]\nname="a\\u2028b"', "has control"),
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


CORRIDOR = """
[floor_plan]
size_m = [10.0, 4.0]
free = [[1.0, 1.0, 9.0, 3.0]]
"""


def test_paths_in_axes_start_from_the_file_and_runs_without_their_map_can_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "there.toml").write_text(f'name = "there"\n{CORRIDOR}')
    path = tmp_path / "sub" / "maps.toml"
    path.parent.mkdir()
    text = (
        'scenario = "three_cells"\nplot = "variants"\nskip_absent = true\n[axes]\nseed = "1..2"\n'
        'building = [{scenario = "../there.toml"}, {scenario = "../gone.yaml", robots = 2}]\n'
        '[[variant]]\nname = "both"\n[[variant]]\nname = "one"\naxes.building = [{scenario = "../there.toml"}]\n'
        '[[variant]]\nname = "set"\naxes.building = [{robots = 3}]\nset.scenario = "../gone.yaml"\n'
    )
    path.write_text(text)
    study = load_study(str(path))
    assert absent(study) == [str(tmp_path / "sub" / "../gone.yaml")]
    assert [point.variant for point in points_of(study)].count("both") == 2
    assert {(p.variant, tomllib.loads(p.toml)["name"]) for p in points_of(study)} == {
        ("both", "there"),
        ("one", "there"),
    }
    path.write_text(text.replace("skip_absent = true", "skip_absent = false"))
    with pytest.raises(ScenarioError, match="gone"):
        points_of(load_study(str(path)))
    path.write_text(text.replace("there.toml", "nowhere.toml"))
    with pytest.raises(ScenarioError, match="none of its scenarios is there"):
        points_of(load_study(str(path)))


def test_some_of_the_runs_can_be_chosen_by_their_parameters() -> None:
    points = shipped("fig7")
    some = select(points, ["seed=1", "seed=2", "radius_m=20", "robots=6"])
    runs = [tomllib.loads(point.toml) for point in some]
    assert sorted((run["robots"], run["radius_m"], run["seed"]) for run in runs) == [(6, 20.0, 1), (6, 20.0, 2)]
    assert select(points, []) == points
    assert {point.variant for point in select(points, ["variant=base", "scenario=three_cells"])} == {"base"}
    assert sample(points, 5) == sample(list(reversed(points)), 5)[::-1]
    assert sample(points, None) == points
