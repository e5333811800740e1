"""How good a robot's links are. The route to the MS asks before it keeps, leaves or adopts an NMS (nms.py).

The paper's answer is received power alone: a link is weak when d_in > r_in [paper 5.3, 5.7], and silence is distance
(rule A [paper 3.7]). A policy that knows more of its links derives from `LinkQuality` and sets `router.ms.links`.
"""

from __future__ import annotations

from mypy_extensions import mypyc_attr

from agents.neighbors import Neighbors


@mypyc_attr(allow_interpreted_subclasses=True)
class LinkQuality:
    """The links of one robot, by received power."""

    def __init__(self, neighbors: Neighbors, r_in_m: float) -> None:
        self.neighbors = neighbors
        self.r_in_m = r_in_m
        self.reach_m = r_in_m
        """d_in beyond which the link to the NMS is weak: r_in, unless a policy stretches it."""

    def weak(self, nms: int, tick: int) -> bool:
        """Whether the link to the NMS is weak now."""
        return self.neighbors.distance_m(nms, tick) > self.reach_m

    def leaving(self) -> bool:
        """Whether the link to the NMS will be lost where the robot wants to go; rule b then applies at once."""
        return False

    def lasting(self, node: int) -> bool:  # noqa: ARG002  # what a policy may want to know
        """Whether the link to a neighbor will hold where the robot wants to go."""
        return True

    def within(self, node: int, limit_m: float) -> bool:  # noqa: ARG002
        """Whether a neighbor that is within `limit_m` by its power is also within it by all else that is known."""
        return True
