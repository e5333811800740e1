"""Occupancy grids: their geometry, lines over them, floor plans and map files."""

from world.grid.geometry import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, GridGeometry, check_grid

__all__ = ["FREE", "MAX_CELLS", "OCCUPIED", "UNKNOWN", "GridGeometry", "check_grid"]
