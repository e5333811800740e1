"""Freedom from loops in whole missions [paper 3.6]."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.scenario import load
from deploy.simulation import Simulation
from tests.helpers.routing_field import Entries, entries_of, stale_hops


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32), policy=st.sampled_from(["vds", "scout"]))
def test_missions_with_pauses_and_restarts_pass_frames_on_by_ever_fresher_entries(seed: int, policy: str) -> None:
    """The same invariant with the real world and robots, which leave and return as in a run."""
    rng = random.Random(seed)
    targets = ["station", "relay:mid", *map(str, range(1, 9))]
    faults = [
        f"{rng.choice(['pause', 'restart'])}:{rng.choice(targets)}@{tick / 10}+{rng.randint(1, 25) / 10}"
        for tick in range(30, 300)
        if rng.random() < 0.25
    ]
    overrides = {"robots": 8, "radius_m": 9.0, "duration_s": 30.0, "seed": seed, "policy": policy, "fault": faults}
    simulation = Simulation(load("three_cells", overrides))
    before: Entries = {}
    stopped = False
    while not stopped:
        snapshot, stopped = simulation.step()
        taking_part = snapshot.nodes[snapshot.present == 1].tolist()
        now = entries_of({robot: simulation.robots[robot].body.router for robot in taking_part}, snapshot.tick)
        assert stale_hops(before, now) == []
        before = now
