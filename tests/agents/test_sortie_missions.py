"""Small floor plans with what stops a chain in real buildings: `sortie` searches them while `scout` can not."""

from __future__ import annotations

import pytest

from deploy.scenario import load
from deploy.simulation import Simulation
from tests import ROOT

CAUSES = {
    "doors": "every room needs a relay in its door",
    "far_side": "the long wing needs all robots, and one of them waits on the wrong side of the MS",
    "corners": "whoever stands at a corner hides the next robot from sight",
}


@pytest.mark.parametrize("cause", CAUSES)
def test_what_stops_a_chain_is_overcome(cause: str) -> None:
    found = {}
    for policy in ("sortie", "scout"):
        path = ROOT / "tests" / "helpers" / "scenarios" / f"{cause}.toml"
        finals = Simulation(load(path, {"policy": policy})).run().finals
        found[policy] = finals["station"]["search_time_s"]["all"] is not None
        absences, made = finals["world"]["planned_absences"], finals["world"]["scan_reports"]
        assert (absences["count"] > 0) == (policy == "sortie")
        if found[policy]:
            assert made["discarded"] == 0
            assert finals["station"]["search_rate"]["all"] == 1.0
    assert found == {"sortie": True, "scout": False}, CAUSES[cause]
