"""Lower bounds of the search [paper 8.4, 8.5]: r_low, below which a fleet can't reach every cell, and T_low."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from deploy.scenario import Scenario
from deploy.scenario.arena import Arena
from deploy.sweep.lower_bound import least_radius_m, reach_from_station
from world.grid.lines import walls_crossed

__all__ = ["Bounds", "bounds_of"]


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of an arena [paper 8.4, 8.5]."""

    farthest_m: float
    """L_far: the longest of the shortest paths from the MS to a point of a search cell."""
    lidar_m: float
    speed_m_s: float
    r_in_share: float
    radio_m: Mapping[int, float] = field(default_factory=dict)
    """r_low by N for the radio that is used: with a smaller r_t no chain of N robots sees every place."""

    @property
    def t_low_s(self) -> float:
        """T_low: one robot walks straight to where it sees the farthest point.

        No robot is faster, except by the few metres from the MS at which it starts; what it takes to sweep the rooms
        is not in it.
        """
        return (self.farthest_m - self.lidar_m) / self.speed_m_s

    def corridor_m(self, robots: int) -> float:
        """What the paper may mean by r_low: N robots form a chain along the path, each link of r_in.

        The last robot sees farther by the range of its lidar, and the chain gains up to one link at its head. A radio
        that passes walls needs less, for its chains need not follow the corridor.
        """
        return (self.farthest_m - self.lidar_m) / (self.r_in_share * (robots + 1))


def bounds_of(scenario: Scenario, fleets: Iterable[int] = ()) -> Bounds:
    """The lower bounds of a scenario, from its true floor plan; r_low for the radio is of these numbers of robots."""
    rules = scenario.tables.rules
    lidar_m, moving, routing = scenario.tables.lidar.range_m, rules.moving, rules.routing
    radio_m = {robots: least_radius_m(scenario, robots) for robots in sorted(set(fleets))}
    return Bounds(_farthest_m(scenario), lidar_m, moving.speed_m_s, routing.r_in_share, radio_m)


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
