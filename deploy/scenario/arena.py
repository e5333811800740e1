"""The arena that a scenario describes: walls, station, search cells, victims, and the starts of the robots."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bus.excerpt import shown
from deploy.scenario.tables import FloorPlan, Point, Rectangle, ScenarioError, Tables
from monitor_station.config import SearchCell
from world.grid import GridGeometry
from world.grid.floor_plan import clearance, connected_parts, from_rectangles, resampled
from world.grid.lines import line_of_sight, pad
from world.grid.map_file import digest_of_map, load_map
from world.seeds import Stream, sequence

__all__ = ["Arena", "survey"]

START_MIN_M: Final = 1.0
START_MAX_M: Final = 3.0
SAFETY_M: Final = 3.0
CLEAR_M: Final = 1.0
"""Distance from the walls to a station without a given position, where there is so much room."""
RESOLUTION_M: Final = 0.5
"""Of a floor plan of rectangles that says nothing of it."""
MOST_RANGE_CELLS: Final = 1000
"""The world keeps a rim of walls as wide as the range of a lidar."""


@dataclass(frozen=True)
class Arena:
    """The resolved floor plan, with the places of station, robots and victims."""

    geometry: GridGeometry
    occupied: NDArray[np.bool_]
    station_m: Point
    safety_zone_m: Rectangle
    starts_m: NDArray[np.float64]
    """(robots, 2)"""
    search_cells: tuple[SearchCell, ...]
    cell_rectangles_m: tuple[Rectangle, ...]
    victims_m: NDArray[np.float64]
    """(v, 2)"""
    unreachable: float
    """Share of the free floor that can't be reached from the station."""
    unreachable_of: tuple[float, ...]
    """Share of the free floor of each search cell that can't be reached."""


def survey(tables: Tables) -> Arena:
    """Resolve the tables.

    Raises:
        ScenarioError: they do not fit the floor plan; the message names the key, not the file.
    """
    occupied, geometry = _floor_plan(tables.floor_plan)
    _check_lidar(tables, geometry)
    parts = connected_parts(occupied)
    station = _station(tables, parts, geometry)
    connected = parts == parts.flat[geometry.index(*station)]
    zone = _safety_zone(tables, occupied, geometry, station)
    cells, rectangles, left_out = _cells(tables, occupied, connected, geometry)
    return Arena(
        geometry,
        occupied,
        station,
        zone,
        _starts(tables, occupied, geometry, station)
        if tables.station.start_radius_m is None
        else _spread(tables, connected, geometry, station, tables.station.start_radius_m),
        cells,
        rectangles,
        _victims(tables, occupied, geometry, cells),
        1.0 - np.count_nonzero(connected) / np.count_nonzero(parts),
        left_out,
    )


def _floor_plan(plan: FloorPlan) -> tuple[NDArray[np.bool_], GridGeometry]:
    try:
        if plan.map is not None:
            if plan.size_m is not None or plan.free or plan.walls:
                raise ScenarioError("floor_plan has both map and rectangles; give either")
            path = Path(plan.map)
            if plan.map_sha256 is not None and digest_of_map(path) != plan.map_sha256:
                raise ScenarioError(
                    f"floor_plan.map: {shown(path)} is not the map of this scenario any more (map_sha256)"
                )
            native = load_map(path)
            return native if plan.resolution_m is None else resampled(*native, plan.resolution_m)
        if plan.size_m is None or not plan.free:
            raise ScenarioError("floor_plan needs either map, or size_m and free rectangles")
        return from_rectangles(plan.size_m, plan.free, plan.walls, plan.resolution_m or RESOLUTION_M)
    except ScenarioError:
        raise
    except ValueError as error:
        raise ScenarioError(f"floor_plan: {error}") from None


def _check_lidar(tables: Tables, geometry: GridGeometry) -> None:
    cells = tables.lidar.range_m / geometry.resolution_m
    if cells > MOST_RANGE_CELLS:
        most = MOST_RANGE_CELLS * geometry.resolution_m
        raise ScenarioError(
            f"lidar.range_m = {tables.lidar.range_m:g}: {cells:g} cells of {geometry.resolution_m:g} m; "
            f"up to {MOST_RANGE_CELLS:,} are possible, here {most:g} m"
        )


def _station(tables: Tables, parts: NDArray[np.int32], geometry: GridGeometry) -> Point:
    """The given position; else, in the largest part of the floor, the place clear of walls nearest to the middle."""
    wanted = tables.station.position_m
    if wanted is not None:
        if not _free(parts == 0, geometry, wanted):
            raise ScenarioError(f"station.position_m = {wanted[0]:g}, {wanted[1]:g} is inside a wall")
        return wanted
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    if not sizes.any():
        raise ScenarioError("floor_plan has no free cell")
    room = clearance(parts == sizes.argmax())
    enough = min(math.ceil(CLEAR_M / geometry.resolution_m), int(room.max()))
    rows = (np.arange(geometry.rows) + 0.5 - geometry.rows / 2)[:, None]
    cols = (np.arange(geometry.cols) + 0.5 - geometry.cols / 2)[None, :]
    return geometry.center(int(np.where(room >= enough, rows**2 + cols**2, math.inf).argmin()))


def _free(occupied: NDArray[np.bool_], geometry: GridGeometry, place: Point) -> bool:
    row, col = geometry.cell(*place)
    return 0 <= row < geometry.rows and 0 <= col < geometry.cols and not occupied[row, col]


def _safety_zone(
    tables: Tables, occupied: NDArray[np.bool_], geometry: GridGeometry, station: Point
) -> tuple[float, float, float, float]:
    x, y = station
    wanted = tables.station.safety_zone_m
    if wanted is not None:
        if not (wanted[0] <= x <= wanted[2] and wanted[1] <= y <= wanted[3]):
            raise ScenarioError(f"station.safety_zone_m = {_list(wanted)} does not hold the station")
        if occupied.ravel()[geometry.rectangle(*wanted)].any():
            raise ScenarioError(f"station.safety_zone_m = {_list(wanted)} holds a wall, but is said to be free")
        return wanted

    def square(half: float) -> Rectangle:
        return x - half, y - half, x + half, y + half

    def holds_no_wall(half: float) -> bool:
        return not occupied.ravel()[geometry.rectangle(*square(half))].any()

    halves = [SAFETY_M]
    while halves[-1] > geometry.resolution_m:
        halves.append(halves[-1] - geometry.resolution_m)
    largest = bisect.bisect_left(halves, True, hi=len(halves) - 1, key=holds_no_wall)
    if largest < len(halves) - 1:
        return square(halves[largest])
    x, y = geometry.center(geometry.index(x, y))
    return square(geometry.resolution_m / 2)


def _cells(
    tables: Tables, occupied: NDArray[np.bool_], connected: NDArray[np.bool_], geometry: GridGeometry
) -> tuple[tuple[SearchCell, ...], tuple[Rectangle, ...], tuple[float, ...]]:
    """The search cells, their rectangles, and the share of the free floor in each that can't be reached."""
    _check_names([cell.name for cell in tables.cell])
    if not tables.cell:
        inside = np.flatnonzero(connected)
        rows, cols = np.flatnonzero(connected.any(axis=1)), np.flatnonzero(connected.any(axis=0))
        low = geometry.center(int(rows[0] * geometry.cols + cols[0]))
        high = geometry.center(int(rows[-1] * geometry.cols + cols[-1]))
        half = geometry.resolution_m / 2
        return (SearchCell("all", inside),), ((low[0] - half, low[1] - half, high[0] + half, high[1] + half),), (0.0,)
    cells, left_out = [], []
    for cell in tables.cell:
        inside = geometry.rectangle(*cell.rectangle_m)
        free = inside[~occupied.ravel()[inside]]
        inside = free[connected.ravel()[free]]
        if not len(inside):
            where = f"cell '{shown(cell.name)}': rectangle_m = {_list(cell.rectangle_m)}"
            raise ScenarioError(f"{where} holds no free place that can be reached from the station")
        cells.append(SearchCell(cell.name, inside))
        left_out.append(1.0 - len(inside) / len(free))
    return tuple(cells), tuple(cell.rectangle_m for cell in tables.cell), tuple(left_out)


def _check_names(names: Sequence[str]) -> None:
    """Each cell names a column of metrics.csv, and a series of a study."""
    taken = {"all", "time_s"}
    for name in names:
        if not name.isprintable():
            raise ScenarioError(f"cell name '{shown(name)}' has control characters or line breaks")
        if name in taken:
            what = "every cell needs its own; 'all' is the whole, 'time_s' the time"
            raise ScenarioError(f"cell name '{shown(name)}' is taken; {what}")
        taken.add(name)


def _starts(tables: Tables, occupied: NDArray[np.bool_], geometry: GridGeometry, station: Point) -> NDArray[np.float64]:
    """Seeded free places 1 to 3 m around the MS from where it can be seen."""
    generator = sequence(tables.seed, Stream.STARTS)
    walls, wider = pad(occupied, geometry, math.ceil(START_MAX_M / geometry.resolution_m) + 1)
    starts: list[Point] = []
    for _ in range(200 * tables.robots + 2000):
        away, angle = generator.uniform(START_MIN_M, START_MAX_M), generator.uniform(0.0, 2.0 * math.pi)
        place = (station[0] + away * math.cos(angle), station[1] + away * math.sin(angle))
        if line_of_sight(walls, wider, place, station) and _apart(tables, place, starts):
            starts.append(place)
            if len(starts) == tables.robots:
                return np.array(starts)
    raise ScenarioError(
        f"station: no free place for robot {len(starts) + 1} of {tables.robots} between "
        f"{START_MIN_M:g} and {START_MAX_M:g} m around the station at {station[0]:g}, {station[1]:g}, "
        f"with body_radius_m = {tables.body_radius_m:g}"
    )


def _apart(tables: Tables, place: Point, starts: Sequence[Point]) -> bool:
    """Whether the body of a robot that starts at a place touches none of those that start elsewhere."""
    apart_m = 2.0 * tables.body_radius_m
    return apart_m == 0.0 or all(math.dist(place, start) > apart_m for start in starts)


def _spread(
    tables: Tables, connected: NDArray[np.bool_], geometry: GridGeometry, station: Point, radius_m: float
) -> NDArray[np.float64]:
    """(robots, 2) seeded centers of free cells, no two alike, up to `radius_m` away and reachable from the MS."""
    places = geometry.centers(np.flatnonzero(connected))
    places = places[np.hypot(*(places - station).T) <= radius_m]
    drawn = len(places) if tables.body_radius_m else min(tables.robots, len(places))
    starts: list[Point] = []
    for x, y in sequence(tables.seed, Stream.STARTS).choice(places, drawn, replace=False).tolist():
        if len(starts) < tables.robots and _apart(tables, (x, y), starts):
            starts.append((x, y))
    if len(starts) < tables.robots:
        raise ScenarioError(
            f"station.start_radius_m = {radius_m:g}: no free cell there for robot {len(starts) + 1} of "
            f"{tables.robots}, with body_radius_m = {tables.body_radius_m:g}"
        )
    return np.array(starts)


def _victims(
    tables: Tables, occupied: NDArray[np.bool_], geometry: GridGeometry, cells: tuple[SearchCell, ...]
) -> NDArray[np.float64]:
    """(v, 2) the given places, or seeded centers of grid cells, no two alike in a search cell."""
    for i, place in enumerate(tables.victims.positions_m, 1):
        if not _free(occupied, geometry, place):
            raise ScenarioError(f"victims.positions_m[{i}] = {place[0]:g}, {place[1]:g} is inside a wall")
    if tables.victims.positions_m:
        return np.array(tables.victims.positions_m, np.float64)
    generator = sequence(tables.seed, Stream.VICTIMS)
    count = tables.victims.per_cell
    places = []
    for cell in cells:
        if count > len(cell.cells):
            only = f"cell '{shown(cell.name)}' has only {len(cell.cells)} places"
            raise ScenarioError(f"victims.per_cell = {count}: {only}")
        places.append(geometry.centers(generator.choice(cell.cells, count, replace=False)))
    return np.concatenate(places)


def _list(values: Rectangle) -> str:
    return ", ".join(f"{value:g}" for value in values)
