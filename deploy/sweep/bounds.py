"""Lower bounds of the search [paper 8.4, 8.5]: r_low, below which a fleet can't reach every cell, and T_low.

Both follow from the longest of the shortest paths over the true floor plan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from agents.own_map import OwnMap
from agents.planner import Planner, Reach
from deploy.scenario import Scenario
from deploy.scenario.arena import Arena
from world.grid.lines import walls_crossed
from world.terms import STATION

__all__ = ["Bounds", "bounds_of", "reach_from_station"]

_SWEEP_S: Final = (0.0, 40.0)
"""Search time beyond the straight walk until the last corner is seen: none if enough robots share the rooms; an
independent prototype measured 25 to 40 s."""


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of an arena [paper 8.4, 8.5]."""

    farthest_m: float
    """L_far: the longest of the shortest paths from the MS to a point of a search cell."""
    lidar_m: float
    speed_m_s: float
    r_in_share: float

    @property
    def t_low_s(self) -> tuple[float, float]:
        """T_low, from and to: one robot walks straight to where it sees the farthest point, then sweeps the rooms.

        No robot is faster than the walk, except by the few metres from the MS at which it starts. The sweep depends on
        the rooms and on how many robots share them, so this is a band.
        """
        walk_s = (self.farthest_m - self.lidar_m) / self.speed_m_s
        return walk_s + _SWEEP_S[0], walk_s + _SWEEP_S[1]

    @property
    def t_low_mid_s(self) -> float:
        """Middle of the band. Claims such as "within 15 % of T_low" are about it."""
        return sum(self.t_low_s) / 2

    def r_low_m(self, robots: int) -> float:
        """r_low: N robots form a chain along the path, each link as long as inner link recovery allows, r_in.

        The last robot sees farther by the range of its lidar, and the chain gains up to one link at its head.
        """
        return (self.farthest_m - self.lidar_m) / (self.r_in_share * (robots + 1))


def bounds_of(scenario: Scenario) -> Bounds:
    """The lower bounds of a scenario, from its true floor plan."""
    rules = scenario.tables.rules
    lidar_m, moving, routing = scenario.tables.lidar.range_m, rules.moving, rules.routing
    return Bounds(_farthest_m(scenario), lidar_m, moving.speed_m_s, routing.r_in_share)


def _farthest_m(scenario: Scenario) -> float:
    """Longest of the shortest paths from the MS to the search cells, straightened from corner to corner.

    A robot that knew all of the floor plan would walk them, so the robots' own planner finds them.
    """
    arena = scenario.arena
    reach = reach_from_station(scenario)
    cells = np.concatenate([cell.cells for cell in arena.search_cells])
    cells = cells[np.isfinite(reach.lengths_m(cells))]
    # Lengths over the grid are up to 8 % too long, depending on direction, so several far cells are tried.
    far = cells[np.argsort(reach.lengths_m(cells))[-400:]]
    return max(_taut_m(arena, reach.path(cell)) for cell in far.tolist())


def reach_from_station(scenario: Scenario) -> Reach:
    """Shortest paths from the MS over the true floor plan."""
    arena = scenario.arena
    known = OwnMap(scenario.robot_config(STATION))
    odds = np.where(arena.occupied.ravel(), np.int8(1), np.int8(-1))
    known.apply(np.arange(arena.geometry.size, dtype=np.uint32), odds)
    return Planner(known).reach(arena.geometry.index(*arena.station_m))


def _taut_m(arena: Arena, path: list[int]) -> float:
    """Length of a path from the MS, without the cells that can be cut short in a straight line of sight."""
    places = arena.geometry.centers(np.array([*reversed(path), arena.geometry.index(*arena.station_m)]))
    length_m, at = 0.0, 0
    while at < len(places) - 1:
        ahead = places[at + 1 :]
        seen = walls_crossed(arena.occupied, arena.geometry, np.broadcast_to(places[at], ahead.shape), ahead) == 0
        step = at + 1 + int(np.flatnonzero(seen)[-1])
        length_m += math.dist(places[at], places[step])
        at = step
    return length_m
