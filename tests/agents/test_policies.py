"""The interface between a robot and its policy, and what distinguishes scout."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.policies import PolicyError, policy_class
from agents.scout import Scout
from agents.sortie import Sortie
from agents.vds import Vds
from deploy.scenario import ScenarioError, load
from deploy.simulation import Simulation

QUICK = {"robots": 4, "duration_s": 20.0}


def test_names_lead_to_classes() -> None:
    assert policy_class("vds") is Vds
    assert policy_class("scout") is Scout
    assert policy_class("sortie") is Sortie
    assert issubclass(policy_class("vds.examples.nearest_frontier:NearestFrontier"), Vds)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("vdss", "vds, scout, sortie, or module:Class"),
        ("no_such_module:Class", "cannot import no_such_module"),
        ("agents.vds:Nothing", "no class Nothing"),
        ("agents.explorer:Explorer", "derived from agents.vds.Vds"),
        ("agents.vds:" + "N" * 100_000, "no class NN"),
        ("m" * 100_000 + ":Class", "cannot import mm"),
        *(
            (name, "or module:Class")
            for name in (":", ":X", "agents.vds:", "..:X", ".vds:Vds", "a..b:X", "a:b:c", "a b:C")
        ),
    ],
)
def test_a_wrong_name_is_one_line(name: str, words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        policy_class(name)
    with pytest.raises(ScenarioError) as error:
        load("three_cells", {"policy": name})
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import sys; sys.exit(7)", "cannot import bad_policy: SystemExit: 7"),
        ("import sys; sys.exit()", "cannot import bad_policy: SystemExit"),
        ("raise BaseException('no')", "cannot import bad_policy: BaseException: no"),
        ("1 / 0", "cannot import bad_policy: ZeroDivisionError"),
        ("def f(:", "cannot import bad_policy: SyntaxError"),
        ("raise ValueError('line\\n' * 10_000)", "cannot import bad_policy: ValueError: line?line"),
        ("import nothing_such", "cannot import bad_policy: No module named"),
        ("def __getattr__(name): raise SystemExit(0)", "cannot import bad_policy: SystemExit: 0"),
        ("from agents.vds import Vds\nclass X(Vds):\n    DEFAULTS = 7", "X.DEFAULTS is not a table"),
    ],
)
def test_a_module_that_cannot_be_imported_is_one_line(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad_policy.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "bad_policy", raising=False)
    with pytest.raises(ScenarioError) as error:
        load("three_cells", {"policy": "bad_policy:X"})
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


def test_a_policy_of_ones_own_runs_and_differs() -> None:
    own = {**QUICK, "policy": "vds.examples.nearest_frontier:NearestFrontier"}
    ours = Simulation(load("three_cells", own)).run()
    assert ours.finals["world"]["connected_fraction"] > 0.9
    assert ours.trace_sha256 != Simulation(load("three_cells", QUICK)).run().trace_sha256


def test_scout_has_its_own_radii_unless_the_scenario_says_otherwise() -> None:
    assert load("three_cells", {"policy": "scout"}).robot_config(1).rules.routing.r_in_share == 0.9
    said = load("three_cells", {"policy": "scout", "rules.routing.r_in_share": 0.7})
    assert said.robot_config(1).rules.routing.r_in_share == 0.7
    again = load("three_cells", {}).robot_config(1).rules.routing.r_in_share
    assert again == 0.8


@pytest.mark.parametrize(
    ("model", "factor"), [("disk", 1.0), ("disk_los", math.inf), ("log_distance", 10 ** (18 / 30))]
)
def test_the_radio_model_is_part_of_a_robots_configuration(model: str, factor: float) -> None:
    assert load("three_cells", {"radio.model": model}).robot_config(1).wall_factor == pytest.approx(factor)
    halved = load("three_cells", {"radio.model": model, "rules.scouting.wall_loss_db": 9.0}).robot_config(1).wall_factor
    assert halved == pytest.approx({"log_distance": 10 ** (9 / 30)}.get(model, factor))


@pytest.mark.parametrize("switch", ["predict", "shield", "hurry", "recruit", "wait", "stretch"])
def test_every_rule_can_be_switched_off(switch: str) -> None:
    overrides = {**QUICK, "policy": "scout", f"rules.scouting.{switch}": False, "radio.model": "disk_los"}
    result = Simulation(load("three_cells", overrides)).run()
    assert result.finals["world"]["ticks"] == 200


def test_scout_walks_faster() -> None:
    """D alone: relays and far targets at 2 km/h."""
    far = {}
    for policy in ("vds", "scout"):
        traces = Simulation(load("three_cells", {**QUICK, "policy": policy})).run().traces
        far[policy] = float(np.linalg.norm(np.diff(traces.xy_m, axis=0), axis=2).max())
    assert far["scout"] >= far["vds"]
