"""A policy that walks where a test sends it, and small rooms to walk in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.vds import STILL, Vds, Velocity
from deploy.scenario import load
from deploy.simulation import Simulation
from tests import ROOT
from world.terms import Cls, Mode, Place

ERRANDS: dict[int, list[tuple[float, Place]]] = {}
"""By robot: from when on it walks to which place; before the first it stands."""


class Errands(Vds):
    """Walks to the place of its last errand that has begun."""

    def behave(self, cls: Cls) -> tuple[Velocity, Mode]:  # noqa: ARG002  # whatever it is
        body = self.body
        due = [place for at_s, place in ERRANDS[body.config.node] if at_s <= body.tick / 10]
        if not due:
            return STILL, Mode.WAIT
        self.target = due[-1]
        return self.to_target.velocity(body.tick, body.at, due[-1], self.rules.moving.trace_speed_m_s), Mode.WALK


def walked(
    floor: str, errands: Mapping[int, list[tuple[float, Place]]], seconds: float, **overrides: Any
) -> Iterator[tuple[Simulation, NDArray[np.float64]]]:
    """Simulation and places (n, 2) of the robots, tick by tick, of a mission on one floor plan."""
    ERRANDS.clear()
    ERRANDS.update(errands)
    base = {"policy": "tests.helpers.errands:Errands", "robots": len(errands), "body_radius_m": 0.25}
    path = ROOT / "tests" / "helpers" / "scenarios" / f"{floor}.toml"
    simulation = Simulation(load(path, base | {"duration_s": seconds} | overrides))
    stopped = False
    while not stopped:
        snapshot, stopped = simulation.step()
        yield simulation, snapshot.xy_m
