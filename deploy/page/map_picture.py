"""The map of a run as one SVG picture: the merged map as a PNG in it, under cells, station, victims and robots."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from deploy.page.charts import COLORS
from deploy.run_folder.reader import Run
from monitor_station.config import cell_title
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

__all__ = ["MAP_KEY", "map_picture"]

_WIDTH: Final = 480.0
_SHADES: Final = {FREE: 255, UNKNOWN: 206, OCCUPIED: 40}

MAP_KEY: Final = (
    ("search", "robot that searches (SR)"), ("relay", "robot that relays (RR)"), ("gone", "robot that was gone"),
    ("hop", "next hop to the MS"), ("station", "monitor station (MS)"), ("found", "victim found"),
    ("missed", "victim not found"),
)  # fmt: skip
"""CSS class of each symbol, and its meaning."""


class _Plan:
    """Maps places in metres to coordinates of the picture."""

    def __init__(self, run: Run, geometry: GridGeometry) -> None:
        self.run, self.geometry = run, geometry
        self.scale: float = _WIDTH / (geometry.cols * geometry.resolution_m)
        self.height: float = geometry.rows * geometry.resolution_m * self.scale

    def x(self, x_m: float) -> float:
        return (x_m - self.geometry.x0_m) * self.scale

    def y(self, y_m: float) -> float:
        return self.height - (y_m - self.geometry.y0_m) * self.scale


def map_picture(run: Run) -> str | None:
    """The picture as SVG; None if the run left no map."""
    if run.map is None:
        return None
    plan = _Plan(run, run.map.geometry)
    title = f"Map of {run.name}"
    description = "The map that the monitor station merged, seen from above, as it was when the run ended."
    png = _png(run.map.cells)
    parts = [
        f'<svg class="map" viewBox="0 0 {_WIDTH:g} {plan.height:.1f}" role="img" aria-label="{escape(title)}">',
        f"<title>{escape(title)}</title><desc>{escape(description)}</desc>",
        f'<image width="{_WIDTH:g}" height="{plan.height:.1f}" preserveAspectRatio="none" href="{png}"/>',
        *_cells(plan),
        *_hops(plan),
        *_victims(plan),
        *_station(plan),
        *_robots(plan),
        "</svg>",
    ]
    return "".join(parts)


def _png(cells: NDArray[np.int8]) -> str:
    shades = np.full(cells.shape, _SHADES[UNKNOWN], np.uint8)
    shades[cells == FREE] = _SHADES[FREE]
    shades[cells == OCCUPIED] = _SHADES[OCCUPIED]
    buffer = io.BytesIO()
    Image.fromarray(shades[::-1]).save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _cells(plan: _Plan) -> Iterator[str]:
    scenario = plan.run.scenario
    if scenario is None:
        return
    for i, (name, (x0, y0, x1, y1)) in enumerate(
        zip(scenario.cell_names, scenario.arena.cell_rectangles_m, strict=False)
    ):
        left, top = plan.x(x0), plan.y(y1)
        width, height = (x1 - x0) * plan.scale, (y1 - y0) * plan.scale
        label = cell_title(name)
        yield (
            f'<rect class="cell s{i % COLORS}" x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" '
            f'height="{height:.1f}"/><text class="cell-name t{i % COLORS}" x="{left + width / 2:.1f}" '
            f'y="{top - 5:.1f}">{escape(label)}</text>'
        )


def _robots(plan: _Plan) -> Iterator[str]:
    for robot, x, y in _places(plan):
        number = escape(str(robot.get("robot", "?")))
        if robot.get("present") is False:
            sign = f'<path class="gone" d="M{x - 5:.1f} {y - 5:.1f}l10 10m0-10l-10 10"/>'
        else:
            kind = "relay" if robot.get("class") == "RR" else "search"
            sign = f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="6"/>'
        name = f'<text class="name" x="{x:.1f}" y="{y + 19:.1f}">{number}</text>'
        yield f"<g><title>robot {number}</title>{sign}{name}</g>"


def _hops(plan: _Plan) -> Iterator[str]:
    spots = {robot.get("robot"): (x, y) for robot, x, y in _places(plan)}
    if plan.run.scenario is not None:
        x_m, y_m = plan.run.scenario.arena.station_m
        spots[0] = (plan.x(x_m), plan.y(y_m))
    for robot, x, y in _places(plan):
        nms = robot.get("nms")
        if robot.get("present") and isinstance(nms, int) and nms in spots:
            end_x, end_y = spots[nms]
            yield f'<path class="hop" d="M{x:.1f} {y:.1f}L{end_x:.1f} {end_y:.1f}"/>'


def _places(plan: _Plan) -> Iterator[tuple[dict[str, object], float, float]]:
    for robot in plan.run.rows("robots_at_end"):
        x_m, y_m = robot.get("x_m"), robot.get("y_m")
        if isinstance(x_m, int | float) and isinstance(y_m, int | float):
            yield robot, plan.x(x_m), plan.y(y_m)


def _station(plan: _Plan) -> Iterator[str]:
    if plan.run.scenario is not None:
        x_m, y_m = plan.run.scenario.arena.station_m
        x, y = plan.x(x_m), plan.y(y_m)
        yield (
            f'<g><title>monitor station</title><rect class="station" x="{x - 7:.1f}" y="{y - 7:.1f}" width="14" '
            f'height="14"/><text class="name" x="{x:.1f}" y="{y + 20:.1f}">MS</text></g>'
        )


def _victims(plan: _Plan) -> Iterator[str]:
    if plan.run.scenario is None:
        return
    told = (event.get("data") for event in plan.run.events if event.get("kind") == "victim")
    found = {data.get("victim") for data in told if isinstance(data, dict)}
    for i, (x_m, y_m) in enumerate(plan.run.scenario.arena.victims_m.tolist()):
        kind = "found" if i in found else "missed"
        x, y = plan.x(x_m), plan.y(y_m)
        words = "found" if i in found else "not found"
        yield f'<path class="{kind}" d="M{x:.1f} {y - 7:.1f}l6 11h-12z"><title>victim {i}: {words}</title></path>'
