"""Bodies: robots are discs of one radius that do not pass through one another.

In a tick every robot moves evenly along its step, all at the same time. At the first contact of two discs each of the
two that approaches the other stays where it is for the rest of the tick; who moves away, or along the other's edge,
goes on. Contacts count in the order of their time, those of one time together. So neither the order of the robots nor
their ids matter: each figure of a pair is the same to the bit from both sides.

To walls a robot is a point, and neither lidar nor radio sees bodies.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry

__all__ = ["Bodies", "first_contacts"]

_ABREAST_M: Final = 1e-12
"""Who comes nearer by less than this in a tick does not approach, ..."""
_OVERLAP_M: Final = 1e-10
"""... unless the two overlap by so much already."""


class Bodies:
    """The discs of a run, and the count of moves that they stopped."""

    def __init__(self, radius_m: float, walls: NDArray[np.bool_], geometry: GridGeometry) -> None:
        """`walls`: (rows, cols), with a closed frame of walls."""
        self._apart_m = 2.0 * radius_m
        self._walls = walls
        self._geometry = geometry
        self.blocked_moves = {"live": 0, "dead": 0}
        """Robot-ticks in which a body stopped a move, by whose body it was; `dead` if one of several was dead."""

    def stop(self, xy_m: NDArray[np.float64], wanted_m: NDArray[np.float64], live: list[bool]) -> NDArray[np.float64]:
        """Places (n, 2) a tick later, no two of them nearer than two radii, but for rounding.

        Args:
            xy_m: (n, 2) places.
            wanted_m: (n, 2) where robots come without bodies; no wall is on the straight way.
            live: (n,) who takes part; the others are dead bodies.
        """
        if not self._apart_m:
            return wanted_m
        stopped_by: dict[int, list[int]] = {}
        done = False
        while not done:
            places, contacts = first_contacts(xy_m, wanted_m, self._apart_m)
            for robot, other in contacts:
                stopped_by.setdefault(robot, []).append(other)
            # A way that touches the corner of a wall has, by rounding, places in it: who would stay in one does not go.
            inside = self._in_wall(places)
            done = not inside.any()
            wanted_m = np.where(inside[:, None], xy_m, wanted_m)
        for others in stopped_by.values():
            self.blocked_moves["live" if all(live[other] for other in others) else "dead"] += 1
        return places

    def _in_wall(self, places_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        g = self._geometry
        cells = np.floor((places_m - (g.x0_m, g.y0_m)) / g.resolution_m).astype(np.int64)
        return self._walls[cells[:, 1], cells[:, 0]]


def first_contacts(
    xy_m: NDArray[np.float64], wanted_m: NDArray[np.float64], apart_m: float
) -> tuple[NDArray[np.float64], list[tuple[int, int]]]:
    """Steps of points, cut back so that no two come nearer than `apart_m`.

    Args:
        xy_m: (n, 2) starts.
        wanted_m: (n, 2) ends of the whole steps.
        apart_m: the starts are that far apart, but for rounding.

    Returns:
        (n, 2) ends, and (stopped point, by which other one) of all contacts.
    """
    step = wanted_m - xy_m
    first, second = _close_pairs(xy_m, step, apart_m)
    taken = np.ones(len(xy_m))
    """Share of its step that each point takes."""
    contacts: list[tuple[int, int]] = []
    now = 0.0
    while first.size:
        moving = (taken == 1.0)[:, None] * step
        places = xy_m + np.minimum(taken, now)[:, None] * step
        gap = places[second] - places[first]
        at = now + _time_to_contact(gap, moving[second] - moving[first], apart_m)
        now = float(at.min())
        if now >= 1.0:
            break
        touching = np.flatnonzero(at == now)
        places = xy_m + np.minimum(taken, now)[:, None] * step
        for a, b in zip(first[touching].tolist(), second[touching].tolist(), strict=True):
            between = places[b] - places[a]
            ahead, behind = _dot(moving[a], between) > 0.0, _dot(moving[b], between) < 0.0
            both = ahead == behind  # neither: by rounding; they do approach
            for point, other, stops in ((a, b, ahead or both), (b, a, behind or both)):
                if stops and moving[point].any():
                    taken[point] = min(taken[point], now)
                    contacts.append((point, other))
    return np.where((taken == 1.0)[:, None], wanted_m, xy_m + taken[:, None] * step), contacts


def _close_pairs(
    xy_m: NDArray[np.float64], step: NDArray[np.float64], apart_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Both sides of all pairs that may meet within their steps."""
    reach = np.hypot(step[:, 0], step[:, 1])
    far = np.hypot(xy_m[:, None, 0] - xy_m[None, :, 0], xy_m[:, None, 1] - xy_m[None, :, 1])
    # Rounding is far below a millimetre.
    near = far <= apart_m + reach[:, None] + reach[None, :] + 1e-3
    first, second = np.nonzero(np.triu(near, 1))
    moving = (reach[first] > 0.0) | (reach[second] > 0.0)
    return first[moving], second[moving]


def _time_to_contact(gap: NDArray[np.float64], closing: NDArray[np.float64], apart_m: float) -> NDArray[np.float64]:
    """(m,) when the length of gap + time * closing falls to `apart_m`; 0 if it is there and falls, inf for never."""
    a, b = (closing * closing).sum(axis=1), (gap * closing).sum(axis=1)
    c = (gap * gap).sum(axis=1) - apart_m * apart_m
    square = b * b - a * c
    # Who follows another one at the same speed seems to come nearer by a last digit, and would be stopped by that.
    abreast = (b > -_ABREAST_M * apart_m) & (c > -_OVERLAP_M * apart_m)
    meet = (b < 0.0) & (square > 0.0) & ~abreast
    times = np.full(len(gap), np.inf)
    times[meet] = np.maximum(c[meet] / (np.sqrt(square[meet]) - b[meet]), 0.0)
    return times


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(a[0]) * float(b[0]) + float(a[1]) * float(b[1])
