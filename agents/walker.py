"""Walking: a path to a goal over the robot's own map, and the velocity along it."""

from __future__ import annotations

import itertools
import math
from typing import Final

from agents.own_map import OwnMap
from agents.planner import Planner, Reach
from world.grid import FREE
from world.terms import TICK_S

_RENEW_TICKS: Final = 100
"""A path that was only lengthened after a moving goal is planned again after this long."""

_BLOCKED_TICKS: Final = 10
"""A robot that walks but hardly moves for this long has met a wall that its map does not show."""

_JUMP_M: Final = 4.0
"""If the goal moved farther than this at once, the present path does not lead there."""


class Walker:
    """The path of one robot: way points in metres, the last of them the goal."""

    def __init__(self, own_map: OwnMap, planner: Planner, same_goal_m: float) -> None:
        """`same_goal_m`: a goal that moved no farther than this keeps its path, unless the robot is near it."""
        self._map = own_map
        self._planner = planner
        self._same_goal_m = same_goal_m
        self._points: list[tuple[float, float]] = []
        self._planned_tick = 0
        self._stretched = False
        self._no_way = False
        """No path was found, so the robot goes straight."""
        self._reverted = own_map.reverted
        """The map's count when the path was last looked at."""
        self._used_tick = -1
        self._last_at = (0.0, 0.0)
        self._blocked_ticks = 0

    def velocity(
        self, tick: int, at: tuple[float, float], goal: tuple[float, float], speed_m_s: float
    ) -> tuple[float, float]:
        """Velocity in m/s along the path to a goal. The goal may have moved since the last tick."""
        points, step_m = self._points, speed_m_s * TICK_S
        if not points or math.dist(points[-1], goal) > min(self._same_goal_m, 0.25 * math.dist(at, goal)):
            self._follow(tick, at, goal)
        elif (self._stretched and tick - self._planned_tick >= _RENEW_TICKS) or self._astray(tick, at, step_m):
            self.plan(tick, at, goal)
        self._used_tick, self._last_at = tick, at
        points = self._points
        while len(points) > 1 and math.dist(at, points[0]) <= step_m:
            points.pop(0)
        if not points:
            return 0.0, 0.0
        dx, dy = points[0][0] - at[0], points[0][1] - at[1]
        length = math.hypot(dx, dy)
        if length < 1e-9:
            return 0.0, 0.0
        speed = min(speed_m_s, length / TICK_S)
        return speed * dx / length, speed * dy / length

    def _astray(self, tick: int, at: tuple[float, float], step_m: float) -> bool:
        """Whether the robot has left its path (something else moved it), or a wall stops it, or the map cuts it."""
        if self._used_tick != tick - 1:
            self._blocked_ticks = 0
            return not self._planner.clear_line(at, self._points[0])
        if self._planner.led_aside and not self._planner.clear_line(at, self._points[0]):
            return True
        moved = math.dist(at, self._last_at) > 0.2 * step_m or math.dist(at, self._points[-1]) < step_m
        self._blocked_ticks = 0 if moved else self._blocked_ticks + 1
        if self._blocked_ticks >= _BLOCKED_TICKS:
            self._blocked_ticks = 0
            return True
        return self._cut(at)

    def _cut(self, at: tuple[float, float]) -> bool:
        """Whether the path leads through cells that are known to be free no longer."""
        if self._reverted == self._map.reverted:
            return False
        self._reverted = self._map.reverted
        way = [at, *self._points]
        if self._no_way or self._map.cells[self._map.geometry.index(*way[-1])] != FREE:
            way.pop()  # a goal where the map shows no floor was never on a clear line
        return not all(self._map.clear_line(*here, *there) for here, there in itertools.pairwise(way))

    def remaining_m(self, at: tuple[float, float]) -> float:
        """Length of the rest of the path."""
        total, here = 0.0, at
        for point in self._points:
            total += math.dist(here, point)
            here = point
        return total

    def _follow(self, tick: int, at: tuple[float, float], goal: tuple[float, float]) -> None:
        """Adapt the path to a goal that moved, and plan again only if no part of the path leads there."""
        if self._planner.clear_line(at, goal):
            self._points = [goal]
            self._stretched = False
            return
        if self._used_tick == tick - 1 and self._points and math.dist(self._points[-1], goal) <= _JUMP_M:
            if len(self._points) > 1 and self._planner.clear_line(self._points[-2], goal):
                self._points[-1] = goal
                self._stretched = True
                return
            if self._planner.clear_line(self._points[-1], goal):
                self._points.append(goal)
                self._stretched = True
                return
        self.plan(tick, at, goal)

    def plan(self, tick: int, at: tuple[float, float], goal: tuple[float, float]) -> None:
        """Plan a new path."""
        cell = self._planner.nearest_free
        g = self._map.geometry
        self._go(tick, at, goal, self._planner.path(cell(g.index(*at)), cell(g.index(*goal))))

    def take(self, tick: int, at: tuple[float, float], goal: tuple[float, float], reach: Reach) -> None:
        """Follow the path of a finished search that started at `at`."""
        cell = self._planner.nearest_free(self._map.geometry.index(*goal))
        self._go(tick, at, goal, reach.path(cell) if reach.length_m(cell) < math.inf else [])

    def _go(self, tick: int, at: tuple[float, float], goal: tuple[float, float], path: list[int]) -> None:
        """Follow a path of cells; without one, go straight to the goal."""
        way = [self._map.geometry.center(cell) for cell in path[:-1]]
        self._no_way = not path
        self._reverted = self._map.reverted
        self._points = self._taut(at, [*way, goal]) if way else [goal]
        self._planned_tick = tick
        self._stretched = False

    def _taut(self, at: tuple[float, float], path: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Pull the path tight: from each way point go straight to the farthest one on a clear line (by bisection)."""
        points: list[tuple[float, float]] = []
        here, first = at, 0
        while first < len(path):
            low, high = first, len(path) - 1
            while low < high:
                middle = (low + high + 1) // 2
                if self._planner.clear_line(here, path[middle]):
                    low = middle
                else:
                    high = middle - 1
            here = path[low]
            points.append(here)
            first = low + 1
        return points
