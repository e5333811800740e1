"""One robot of policy scout, or of one on top of it, at a wall, among neighbors that stand where a test puts them."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any

import numpy as np

from agents.body import Body
from agents.forwarding_table import freshness_of
from agents.policies import policy_class
from agents.scout import Scout
from deploy.scenario import load
from tests.helpers.routing_field import power_dbm
from world.grid import FREE, OCCUPIED
from world.terms import STATION, TICK_S, Cls, Mode

TRACE_M_S = 2.0 / 3.6
CORNER = (19.0, 1.0)
"""In sight of everything behind the wall that is far enough to the east."""
WEST = (5.0, 8.0)


class Stage:
    """Robot 1 on a map that it knows: free, but for a wall at 5 < y < 6 that ends at x = 20."""

    def __init__(
        self,
        policy: str = "scout",
        *,
        bodies_m: float = 0.0,
        giving_way: Mapping[str, float | bool] | None = None,
        **switches: float | bool,
    ) -> None:
        """`switches`: keys of the policy's own table of rules; `giving_way`: those of that table."""
        table = "scouting" if policy == "scout" else "sorties"
        rules = {f"rules.{table}.{name}": value for name, value in switches.items()}
        rules |= {f"rules.giving_way.{name}": value for name, value in (giving_way or {}).items()}
        overrides = {"policy": policy, "radio.model": "disk_los", "body_radius_m": bodies_m, **rules}
        config = load("three_cells", overrides).robot_config(1)
        self.body = Body(config, random.Random(1), 0)
        grid = np.full((config.geometry.rows, config.geometry.cols), FREE, np.int8)
        grid[10:12, :40] = OCCUPIED
        odds = np.where(grid.ravel() == FREE, -1, 1).astype(np.int8)
        self.body.map.apply(np.arange(grid.size, dtype=np.uint32), odds)
        made = policy_class(policy)(self.body)
        assert isinstance(made, Scout)
        self.scout = made
        self.body.tick = 1

    def other(
        self,
        node: int,
        at: tuple[float, float],
        *,
        target: tuple[float, float] = (0.0, 0.0),
        cls: Cls = Cls.SR,
        **more: Any,
    ) -> None:
        """A neighbor that was heard just now."""
        body, table = self.body, self.body.router.table
        table.set_inherent(node, cls, at, target, need=more.pop("need", False))
        table.set_route(node, freshness_of(2, 1), node)
        neighbor = body.router.neighbors.hear(node, body.tick, power_dbm(math.dist(body.at, at)))
        for name, value in more.items():
            setattr(neighbor, name, value)

    @staticmethod
    def freshness(hops: int) -> int:
        """Of an entry for the MS with so many hops."""
        return freshness_of(2, hops)

    def nms(self, node: int) -> None:
        self.body.router.table.set_route(STATION, freshness_of(2, 2), node)

    def walk_west_until_the_wall_hides(self, place: tuple[float, float]) -> None:
        """Stand behind the wall where one step west would lose sight of a place, on the way to WEST."""
        x, y = 24.0, WEST[1]
        step_m = TRACE_M_S * TICK_S
        while self.body.map.obstacles(x - step_m, y, *place) == 0:
            x -= step_m
        self.body.at = x, y
        self.scout.target = WEST

    def decide(self) -> tuple[tuple[float, float], Mode]:
        """One tick of a search robot on its way."""
        return self.scout.behave(Cls.SR)
