"""The MS's map as square tiles, so that only changed tiles are recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from world.grid import FREE, OCCUPIED, GridGeometry

TILE: Final = 64
"""Cells along a side of a tile."""

FREE_BYTE: Final = 0
WALL_BYTE: Final = 100
UNKNOWN_BYTE: Final = 255


@dataclass(frozen=True, slots=True)
class Tile:
    """Position and size of one tile."""

    row: int
    """First row of cells; row 0 is the lowest."""
    col: int
    rows: int
    cols: int
    x0_m: float
    y0_m: float
    name: str
    """`tRRR_CCC`: row and column among the tiles."""


class MapTiles:
    """An occupancy image in ROS's bytes (0 free, 100 wall, 255 unknown), cut into tiles."""

    def __init__(self, geometry: GridGeometry) -> None:
        self._cols = geometry.cols
        self._image = np.full((geometry.rows, geometry.cols), UNKNOWN_BYTE, np.uint8)
        side = TILE * geometry.resolution_m
        across = -(-geometry.cols // TILE)
        self.tiles = tuple(
            Tile(
                row * TILE, col * TILE, min(TILE, geometry.rows - row * TILE), min(TILE, geometry.cols - col * TILE),
                geometry.x0_m + col * side, geometry.y0_m + row * side, f"t{row:03d}_{col:03d}",
            )
            for row in range(-(-geometry.rows // TILE))
            for col in range(across)
        )  # fmt: skip
        self._across = across
        self._dirty: set[int] = set()

    def apply(self, cells: NDArray[np.int64], values: NDArray[np.int8]) -> None:
        """Set flat cell indices to FREE or OCCUPIED; anything else is unknown."""
        painted = np.where(values == FREE, FREE_BYTE, np.where(values == OCCUPIED, WALL_BYTE, UNKNOWN_BYTE))
        self._image.reshape(-1)[cells] = painted
        rows, cols = np.divmod(cells, self._cols)
        self._dirty.update(((rows // TILE) * self._across + cols // TILE).tolist())

    def take(self) -> list[tuple[Tile, bytes]]:
        """Tiles that changed since the last call, in order, and their bytes, the top row first."""
        changed = [self.tiles[index] for index in sorted(self._dirty)]
        self._dirty.clear()
        return [(tile, self.pixels(tile)) for tile in changed]

    def pixels(self, tile: Tile) -> bytes:
        """A tile's bytes, the top row first as a GridMap wants it."""
        part = self._image[tile.row : tile.row + tile.rows, tile.col : tile.col + tile.cols]
        return part[::-1].tobytes()
