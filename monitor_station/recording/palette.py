"""Colors of the recording: Okabe & Ito's set, which people with any color vision can tell apart.

The map has a ground of its own (white free, black wall, gray unknown), so the colors suit a light and a dark viewer.
"""

from __future__ import annotations

from typing import Final

from monitor_station.recording.states import State
from world.terms import Cls

Rgb = tuple[int, int, int]

ORANGE: Final[Rgb] = (230, 159, 0)
SKY: Final[Rgb] = (86, 180, 233)
GREEN: Final[Rgb] = (0, 158, 115)
YELLOW: Final[Rgb] = (240, 228, 66)
BLUE: Final[Rgb] = (0, 114, 178)
VERMILION: Final[Rgb] = (213, 94, 0)
PURPLE: Final[Rgb] = (204, 121, 167)
BLACK: Final[Rgb] = (0, 0, 0)
GRAY: Final[Rgb] = (150, 150, 150)
PALE: Final[Rgb] = (225, 225, 225)
GROUND: Final[Rgb] = (74, 80, 84)
"""Background of the map, in any theme of the viewer."""


STATE_NAMES: Final = tuple(state.name.lower() for state in State)
STATE_COLORS: Final[tuple[Rgb, ...]] = (ORANGE, SKY, YELLOW, BLUE, PURPLE, GRAY, VERMILION)

RIM_COLORS: Final[tuple[Rgb, ...]] = (PALE, PALE, YELLOW, BLUE, PURPLE, BLACK, VERMILION)
RIM_POINTS: Final = (9.0, 9.0, 9.5, 9.5, 9.5, 12.0, 12.0)
"""Rim around a robot's true place: pale while all is well, else by its state; radius in points."""

CLASS_COLORS: Final[dict[int, Rgb]] = {Cls.SR: ORANGE, Cls.RR: SKY}
NO_CONTACT: Final = PURPLE
CHAIN: Final = VERMILION
LINK: Final = BLUE
LABEL: Final = BLACK
"""The viewer draws labels on a half transparent plate in the color of its theme: on a white map black is legible."""
FOUND: Final = GREEN
NOT_FOUND: Final = YELLOW

CELL_COLORS: Final[tuple[Rgb, ...]] = (SKY, ORANGE, GREEN, PURPLE, VERMILION, YELLOW)
"""Colors of the search-rate curves, in the scenario's order of cells; repeated beyond six."""
