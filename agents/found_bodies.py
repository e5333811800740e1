"""Bodies that say nothing and that a robot ran into: paths lead around them for a while. They are no walls."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from world.grid import GridGeometry
from world.terms import Place

_MOST: Final = 16
"""Most bodies that are remembered."""


class Found:
    """Silent bodies that a robot ran into, until they are forgotten."""

    def __init__(self, geometry: GridGeometry, apart_m: float) -> None:
        """`apart_m`: two radii."""
        self._geometry = geometry
        self._apart_m = apart_m
        self._places: list[tuple[Place, int]] = []
        """With the tick until which each is remembered."""

    def __bool__(self) -> bool:
        return bool(self._places)

    def add(self, place: Place, until_tick: int) -> None:
        """Remember a body; one that is known, as near as half a radius, is remembered for longer."""
        kept = [p for p in self._places if math.dist(p[0], place) > self._apart_m / 4.0]
        self._places = [*kept, (place, until_tick)][-_MOST:]

    def forget(self, tick: int) -> None:
        """Forget those whose time is over."""
        if self._places:
            self._places = [p for p in self._places if p[1] > tick]

    def places(self) -> list[Place]:
        """Where they stand."""
        return [place for place, _ in self._places]

    def cells(self) -> NDArray[np.int64]:
        """Cells whose centers no robot can reach because of them."""
        g, cells = self._geometry, []
        for (x, y), _ in self._places:
            box = g.rectangle(x - self._apart_m, y - self._apart_m, x + self._apart_m, y + self._apart_m)
            away = np.hypot(*(g.centers(box) - (x, y)).T)
            cells.append(box[away < self._apart_m])
        return np.concatenate(cells) if cells else np.zeros(0, np.int64)

    def clear(self, a: Place, b: Place) -> bool:
        """Whether a segment that begins at a place beside them leads past all of them."""
        return all(_passes(a, b, place, self._apart_m) for place, _ in self._places)


def _passes(a: Place, b: Place, body: Place, apart_m: float) -> bool:
    """Whether the segment keeps its distance from a body, or leads away from it."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    along = ((body[0] - a[0]) * dx + (body[1] - a[1]) * dy) / square if square else 0.0
    if along <= 0.0:
        return True
    along = min(along, 1.0)
    return math.dist((a[0] + along * dx, a[1] + along * dy), body) >= apart_m
