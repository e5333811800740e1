"""Links as a robot's own map predicts them: every wall in between makes a neighbor seem farther away (docs/scout.md).

p(x, y) is the distance at which y will seem to be when heard from x: metres times `wall_factor` for each run of cells
in between that the own map does not know to be free. Other robots are taken to stand where they were last heard to be.
"""

from __future__ import annotations

import math

from mypy_extensions import mypyc_attr

from agents.body import Body
from agents.config import MOST_DECADES
from agents.link_quality import LinkQuality
from world.terms import Place


@mypyc_attr(allow_interpreted_subclasses=True)
class PredictedLinks(LinkQuality):
    """The links of one robot, by received power and by its map."""

    def __init__(self, body: Body, *, predict: bool) -> None:
        """`predict`: False means that the route to the MS follows received power alone."""
        super().__init__(body.router.neighbors, body.router.ms.r_in_m)
        self._body = body
        self._wall_factor = body.config.wall_factor
        self._predicts = predict and self._wall_factor > 1.0
        self._most_walls = max(1, int(MOST_DECADES / max(math.log10(self._wall_factor), 1.0)))
        """More walls than so many make no difference."""
        self.held_from: Place | None = None
        """Where the robot would go if that did not lose its NMS; None while B does not stop it."""

    def predicted_m(self, place: Place, node: int) -> float:
        """p: how far away a node will seem from a place."""
        other = self._body.router.table.location_m(node)
        metres = math.dist(place, other)
        if self._wall_factor == 1.0:
            return metres
        walls = min(self._body.map.obstacles(*place, *other), self._most_walls)
        return metres * self._wall_factor**walls if walls else metres

    def weak(self, nms: int, tick: int) -> bool:
        """Whether the link to the NMS is weak, by power or by the walls in between."""
        return super().weak(nms, tick) or not self.within(nms, self.reach_m)

    def leaving(self) -> bool:
        """Whether the robot stands because its next step would lose the NMS (B)."""
        return self.held_from is not None

    def lasting(self, node: int) -> bool:
        """Whether a neighbor stays within r_in where the robot wants to go."""
        return self.held_from is None or self.predicted_m(self.held_from, node) <= self.r_in_m

    def within(self, node: int, limit_m: float) -> bool:
        """Whether a neighbor seems within `limit_m` through the walls in between."""
        return not self._predicts or self.predicted_m(self._body.at, node) <= limit_m
