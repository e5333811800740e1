"""What no fleet can beat on a floor plan: how long a chain to the MS it needs, and how much time.

chain   the fewest robots that stand so that each hears the next one, the first hears the MS, and the last one sees a
        place with its lidar. Found breadth first over places a metre apart; two hear each other if d f^w <= r_t, where
        w is the number of walls in between and f what one costs (1 for `disk`, infinite for `disk_los`).
walk    one robot walks at top speed along the shortest path until it sees the last place.
sweep   N robots at top speed show at most 2 R v of new floor a second each, where R is the range of their lidars,
        beyond what they see from where they start.

Chains are those that the places allow, so a chain is possible as it is found, and at most a little longer than need be.
The times are safe bounds: lengths over a grid are shortened by as much as a grid makes them too long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.config import Scouting
from agents.own_map import OwnMap
from agents.planner import Planner, Reach
from deploy.scenario import Scenario
from deploy.scenario.arena import START_MAX_M, Arena
from world.grid.lines import walls_crossed
from world.terms import STATION

__all__ = ["LowerBound", "least_radius_m", "lower_bound", "reach_from_station"]

_APART_M: Final = 1.0
"""Distance between the places at which robots of a chain may stand."""
_GRID_DETOUR: Final = math.sqrt(4.0 - 2.0 * math.sqrt(2.0))
"""A path in eight directions is at most this many times as long as a straight line: 1.08."""
_NEVER: Final = -1
_RADIUS_STEP_M: Final = 0.25
"""`least_radius_m` is a multiple of this."""


@dataclass(frozen=True)
class LowerBound:
    """Lower bounds of one scenario."""

    robots: int
    duration_s: float
    area_m2: float
    """Floor of the search cells."""
    hops: int
    """Fewest links from the MS to a robot that stands at the place that is most links away."""
    chains: NDArray[np.int64]
    """(g,) fewest robots in a chain whose last one sees each place of the search cells; -1 if none does."""
    walk_s: float
    sweep_s: float

    @property
    def chain(self) -> int | None:
        """Robots that a chain needs until every place has been seen; None if no chain can see one of them."""
        return None if (self.chains == _NEVER).any() else int(self.chains.max(initial=0))

    @property
    def within(self) -> float:
        """Share of the places that a chain of all robots can see."""
        seen = (self.chains != _NEVER) & (self.chains <= self.robots)
        return float(np.count_nonzero(seen) / max(len(seen), 1))

    @property
    def t_low_s(self) -> float:
        """T_low: no mission is searched earlier."""
        return max(self.walk_s, self.sweep_s)

    @property
    def feasible(self) -> bool:
        """Whether the robots suffice for every chain, and the time for walk and sweep."""
        return self.within == 1.0 and self.t_low_s <= self.duration_s


def lower_bound(scenario: Scenario) -> LowerBound:
    """The lower bounds of a scenario, from its true floor plan, its robots, and its radio without shadowing."""
    arena, tables = scenario.arena, scenario.tables
    lidar_m, moving = tables.lidar.range_m, tables.rules.moving
    top_m_s = max(moving.speed_m_s, moving.trace_speed_m_s)
    cells = np.unique(np.concatenate([cell.cells for cell in arena.search_cells]))
    lengths_m = reach_from_station(scenario)
    places = _places(arena, lengths_m.reached())
    goals = places[np.isin(places, cells)]
    hops = _hops(scenario, arena.geometry.centers(places), scenario.radius_m)
    chains = _chains(scenario, places, hops, goals)
    walks_m = np.sort(lengths_m.lengths_m(places))
    nearest = places[np.argsort(lengths_m.lengths_m(places), kind="stable")]
    last = _first_in_sight(arena, lidar_m, nearest, goals)
    walk_m = float(walks_m[last[last != _NEVER]].max(initial=0.0)) - _APART_M
    start_m = tables.station.start_radius_m or START_MAX_M
    unknown = np.setdiff1d(cells, arena.geometry.rectangle(*arena.safety_zone_m))
    seen_m2 = math.pi * min(scenario.robots * lidar_m**2, (start_m + lidar_m) ** 2)
    rest_m2 = len(unknown) * arena.geometry.resolution_m**2 - seen_m2
    return LowerBound(
        robots=scenario.robots,
        duration_s=scenario.duration_s,
        area_m2=len(cells) * arena.geometry.resolution_m**2,
        hops=int(hops.max()),
        chains=chains,
        walk_s=max(walk_m / _GRID_DETOUR - start_m, 0.0) / top_m_s,
        sweep_s=max(rest_m2, 0.0) / (scenario.robots * 2.0 * lidar_m * top_m_s),
    )


def least_radius_m(scenario: Scenario, robots: int) -> float:
    """r_low for the radio that is used: the least r_t with which a chain of N robots sees every place; else infinite.

    Places are `_APART_M` apart, so it may be too large by as much.

    Args:
        scenario: its floor plan, its radio without shadowing, and its lidar; its own radius does not matter.
        robots: N.
    """
    arena = scenario.arena
    places = _places(arena, reach_from_station(scenario).reached())
    goals = places[np.isin(places, np.concatenate([cell.cells for cell in arena.search_cells]))]
    side_m = max(arena.geometry.rows, arena.geometry.cols) * arena.geometry.resolution_m
    low, high = 0, math.ceil(2.0 * side_m / _RADIUS_STEP_M)
    most = high
    while high - low > 1:
        middle = (low + high) // 2
        hops = _hops(scenario, arena.geometry.centers(places), middle * _RADIUS_STEP_M)
        chains = _chains(scenario, places, hops, goals)
        if ((chains != _NEVER) & (chains <= robots)).all():
            high = middle
        else:
            low = middle
    return math.inf if high == most else high * _RADIUS_STEP_M


def reach_from_station(scenario: Scenario) -> Reach:
    """Shortest paths from the MS over the true floor plan."""
    arena = scenario.arena
    known = OwnMap(scenario.robot_config(STATION))
    odds = np.where(arena.occupied.ravel(), np.int8(1), np.int8(-1))
    known.apply(np.arange(arena.geometry.size, dtype=np.uint32), odds)
    return Planner(known).reach(arena.geometry.index(*arena.station_m))


def _chains(
    scenario: Scenario, places: NDArray[np.int64], hops: NDArray[np.int64], goals: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(g,) fewest robots in a chain whose last one sees each goal; `hops` are those of the places."""
    by_hops = np.argsort(hops, kind="stable")
    by_hops = by_hops[hops[by_hops] != _NEVER]
    first = _first_in_sight(scenario.arena, scenario.tables.lidar.range_m, places[by_hops], goals)
    if not by_hops.size:
        return first
    chains: NDArray[np.int64] = np.where(first == _NEVER, _NEVER, np.maximum(hops[by_hops][first], 1))
    return chains


def _places(arena: Arena, free: NDArray[np.int64]) -> NDArray[np.int64]:
    """One of the cells `free` for every square of `_APART_M`: the one nearest to its middle; ascending."""
    geometry = arena.geometry
    side = max(round(_APART_M / geometry.resolution_m), 1)
    rows, cols = np.divmod(free, geometry.cols)
    off = (rows % side - (side - 1) / 2) ** 2 + (cols % side - (side - 1) / 2) ** 2
    square = (rows // side) * geometry.cols + cols // side
    order = np.lexsort((free, off, square))
    _, first = np.unique(square[order], return_index=True)
    return np.sort(free[order[first]])


def _hops(scenario: Scenario, places_m: NDArray[np.float64], radius_m: float) -> NDArray[np.int64]:
    """(n,) fewest links of `radius_m` at most from the MS to a robot at each place; -1 where no chain leads."""
    radio, arena = scenario.tables.radio, scenario.arena
    factor = Scouting().wall_factor(radio.model, radio.wall_loss_db, radio.exponent)
    hops = np.full(len(places_m), _NEVER)
    senders, count = np.array([arena.station_m]), 0
    while len(senders):
        count += 1
        for sender in senders:
            near, distances_m, walls = _around(arena, sender, places_m, hops == _NEVER, radius_m)
            seems_m = distances_m * np.power(factor, walls, where=walls > 0, out=np.ones(len(near)))
            hops[near[seems_m <= radius_m]] = count
        senders = places_m[hops == count]
    return hops


def _first_in_sight(
    arena: Arena, range_m: float, places: NDArray[np.int64], goals: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(g,) row of the first of the places from which a lidar sees each goal; -1 if none does."""
    first = np.full(len(goals), _NEVER)
    goals_m = arena.geometry.centers(goals)
    for row, place_m in enumerate(arena.geometry.centers(places)):
        near, _, walls = _around(arena, place_m, goals_m, first == _NEVER, range_m)
        first[near[walls == 0]] = row
    return first


def _around(
    arena: Arena, at_m: NDArray[np.float64], places_m: NDArray[np.float64], wanted: NDArray[np.bool_], range_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """The rows of the wanted places in range of a place, with their distances and the walls in between."""
    squares_m2 = (places_m[:, 0] - at_m[0]) ** 2 + (places_m[:, 1] - at_m[1]) ** 2
    near = np.flatnonzero(wanted & (squares_m2 <= range_m**2))
    there = places_m[near]
    walls = walls_crossed(arena.occupied, arena.geometry, np.broadcast_to(at_m, there.shape), there)
    return near, np.sqrt(squares_m2[near]), walls
