"""Occupancy grids: their geometry, lines over them, floor plans and map files."""

from world.grid.geometry import FREE, OCCUPIED, UNKNOWN, GridGeometry

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "GridGeometry"]
