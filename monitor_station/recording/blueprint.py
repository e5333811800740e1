"""The layout that a recording opens with, and the styles of its entities: no click is needed to read it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from monitor_station.config import RecorderConfig
from monitor_station.recording import palette
from monitor_station.recording.tiles import Tile
from world.terms import TICK_S

LEGEND: Final = """\
**Map** white: explored and free, black: wall, dark: unknown; lighter: true rooms that the MS does not know yet.

**Dots** robots where the MS believes them: **orange** search (SR), **light blue** relay (RR), **purple** no route
to the MS. **Rim** a robot's true place: pale: all is well, **yellow** recovers a link, **purple** lost its path,
**black** paused, **red** dead.

**Red line** chain from the farthest SR to the MS, **dark blue** all other next hops (NMS), **gray** trails.

**Green square** MS, **small orange dots** targets, **yellow** victim not found, **green** victim found.

In the blueprint panel (button at the top right) `network/range` shows each radio's reach.
"""

GRAPH_SIZE: Final = (620.0, 230.0)
"""Width and height of the routing graph."""

_FIELD_OF_VIEW_DEG: Final = 55.0
_TRAIL_S: Final = 90.0
_FEW_ROBOTS: Final = 12


def build(config: RecorderConfig) -> rrb.Blueprint:
    """The map from above; beside it legend, progress, network and events, then routes, states and tables."""
    tables = [
        rrb.TextDocumentView(origin=f"network/table/{node}", name=f"Table {node}")
        for node in range(1, config.robots + 1)
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            _map_view(config),
            rrb.Vertical(
                rrb.TextDocumentView(origin="legend", name="Legend"),
                _plot("plots/search", "Searched share of each cell", (0.0, 1.0)),
                _plot("plots/network", "Robots connected, hops to the MS", None),
                rrb.TextLogView(origin="events", name="Events"),
                row_shares=[11, 11, 11, 7],
            ),
            rrb.Vertical(
                rrb.GraphView(
                    origin="network/graph",
                    name="Routes to the MS",
                    visual_bounds=rrb.VisualBounds2D(
                        x_range=(-0.05 * GRAPH_SIZE[0], 1.05 * GRAPH_SIZE[0]),
                        y_range=(-0.1 * GRAPH_SIZE[1], 1.1 * GRAPH_SIZE[1]),
                    ),
                ),
                rrb.StateTimelineView(origin="network/state", name="What each robot does", time_view=_so_far()),
                rrb.Tabs(*tables, name="Forwarding tables"),
                row_shares=[9, 16, 12],
            ),
            column_shares=[13, 9, 10],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sim_time"),
        auto_layout=False,
        auto_views=False,
    )


def _map_view(config: RecorderConfig) -> rrb.Spatial3DView:
    geometry = config.geometry
    width = geometry.cols * geometry.resolution_m
    height = geometry.rows * geometry.resolution_m
    x, y = geometry.x0_m + width / 2, geometry.y0_m + height / 2
    away = 1.05 * max(height, width) / (2 * math.tan(math.radians(_FIELD_OF_VIEW_DEG / 2)))
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /ms/**", "+ /network/**", "+ /truth/**", "- /network/graph/**", "- /network/state/**"],
        name="Map",
        background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=palette.GROUND),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=(x, y, away), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0)
        ),
        overrides={
            "ms/trails": _recent(_TRAIL_S if config.robots <= _FEW_ROBOTS else _TRAIL_S / 4),
            "network/range": rrb.EntityBehavior(visible=False),
        },
    )


def _recent(length_s: float) -> rrb.VisibleTimeRanges:
    """Everything of the last seconds, whichever timeline the viewer follows."""
    now = rr.TimeRangeBoundary.cursor_relative()
    seconds = rr.TimeRangeBoundary.cursor_relative(seconds=-length_s)
    ticks = rr.TimeRangeBoundary.cursor_relative(seq=int(-length_s / TICK_S))
    return rrb.VisibleTimeRanges(
        [
            rr.VisibleTimeRange("sim_time", start=seconds, end=now),
            rr.VisibleTimeRange("tick", start=ticks, end=now),
        ]
    )


def _so_far() -> rrb.TimeAxis:
    """From the start to a little after the cursor; the viewer's own choice is 30 s."""
    return rrb.TimeAxis(
        view_range=rr.TimeRange(
            start=rr.TimeRangeBoundary.absolute(seconds=0.0), end=rr.TimeRangeBoundary.cursor_relative(seconds=5.0)
        )
    )


def _plot(origin: str, name: str, bounds: tuple[float, float] | None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=_so_far(),
        axis_y=rrb.ScalarAxis(range=bounds) if bounds else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )


class Height:
    """z of each layer in metres: what matters lies on top."""

    MAP: Final = 0.0
    TRUE_MAP: Final = 0.02
    TRAIL: Final = 0.1
    TARGET: Final = 0.2
    VICTIM: Final = 0.25
    LINK: Final = 0.3
    CHAIN: Final = 0.4
    RIM: Final = 0.45
    ROBOT: Final = 0.5
    LABEL: Final = 0.6


def lift(xy_m: NDArray[Any], z_m: float) -> NDArray[np.float32]:
    """(..., 2) places as (..., 3) points at one height."""
    points = np.empty((*xy_m.shape[:-1], 3), np.float32)
    points[..., :2] = xy_m
    points[..., 2] = z_m
    return points


_FLAT: Final = rr.components.PointShading.Flat


def write_static(rec: rr.RecordingStream, config: RecorderConfig, tiles: Sequence[Tile]) -> None:
    """Write what never changes: floor plan, places, sizes and styles."""
    _write_maps(rec, config, tiles)
    _write_places(rec, config)
    _write_moving(rec, config)
    _write_plots(rec, config)


def _write_maps(rec: rr.RecordingStream, config: RecorderConfig, tiles: Sequence[Tile]) -> None:
    geometry = config.geometry
    shades = np.zeros((geometry.rows, geometry.cols, 4), np.uint8)
    shades[~config.occupied] = (255, 255, 255, 70)
    plan = rr.GridMap(
        data=shades[::-1].tobytes(),
        format=_image_format(geometry.cols, geometry.rows, "RGBA"),
        cell_size=geometry.resolution_m,
        translation=(geometry.x0_m, geometry.y0_m, Height.TRUE_MAP),
        draw_order=1.0,
        opacity=0.99,
    )
    rec.log("truth/map", plan, static=True)
    for tile in tiles:
        shape = rr.GridMap.from_fields(
            format=_image_format(tile.cols, tile.rows, "L"),
            cell_size=geometry.resolution_m,
            translation=(tile.x0_m, tile.y0_m, Height.MAP),
            colormap=rr.components.Colormap.RvizMap,
            draw_order=0.0,
        )
        rec.log(f"ms/map/{tile.name}", shape, static=True)


def _image_format(width: int, height: int, color_model: Literal["L", "RGBA"]) -> rr.components.ImageFormat:
    return rr.components.ImageFormat(width=width, height=height, color_model=color_model, channel_datatype="U8")


def _write_places(rec: rr.RecordingStream, config: RecorderConfig) -> None:
    """The station, the search cells and the victims."""
    x, y = config.station_m
    box = rr.Boxes3D(
        centers=[(x, y, Height.LINK)],
        half_sizes=[(0.9, 0.9, 0.05)],
        colors=palette.GREEN,
        fill_mode="solid",
    )
    rec.log("ms/station", box, static=True)
    name = rr.Points3D.from_fields(positions=[(x, y - 1.0, Height.LABEL)], labels=["MS"])
    rec.log("ms/station/name", name, _names(), static=True)
    if config.cell_rectangles_m:
        outlines = [
            lift(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]), Height.TRAIL)
            for x0, y0, x1, y1 in config.cell_rectangles_m
        ]
        tops = np.array([((x0 + x1) / 2, y1) for x0, _, x1, y1 in config.cell_rectangles_m])
        colors = cell_colors(len(tops))
        rec.log("ms/cells/outline", rr.LineStrips3D(outlines, radii=_ui(2.0), colors=colors), static=True)
        rec.log("ms/cells", rr.Points3D.from_fields(positions=lift(tops, Height.LABEL)), _names(), static=True)
    rec.log("ms/victims", _dots(6.0, colors=palette.FOUND), static=True)
    if len(config.victims_m):
        places = lift(config.victims_m, Height.TARGET)
        rec.log("truth/victims", _dots(6.0, colors=palette.NOT_FOUND, positions=places), static=True)


def _write_moving(rec: rr.RecordingStream, config: RecorderConfig) -> None:
    """Sizes and colors of what moves."""
    styles = {
        "ms/robots": _dots(7.0),
        "ms/names": _names(),
        "truth/robots": rr.Points3D.from_fields(point_shading=_FLAT),
        "truth/gone": _names(),
        "network/targets": _dots(3.0, colors=palette.ORANGE),
        "ms/trails": _lines(0.8, (110, 110, 110)),
        "network/links": _lines(1.5, palette.LINK),
        "network/chain": _lines(3.0, palette.CHAIN),
        "network/range": rr.Cylinders3D.from_fields(
            lengths=[0.0],
            radii=[config.radius_m],
            colors=palette.GRAY,
            fill_mode="majorwireframe",
            line_radii=_ui(0.7),
        ),
    }
    for path, style in styles.items():
        rec.log(path, style, static=True)
    states = rr.StateConfiguration(values=palette.STATE_NAMES, colors=palette.STATE_COLORS)
    for node in range(1, config.robots + 1):
        rec.log(f"network/state/{node}", states, static=True)


def _write_plots(rec: rr.RecordingStream, config: RecorderConfig) -> None:
    rec.log("legend", rr.TextDocument(LEGEND, media_type="text/markdown"), static=True)
    names = cell_names(config)
    search = rr.SeriesLines(names=names, colors=cell_colors(len(names)), widths=[2.5] * len(names))
    rec.log("plots/search", search, static=True)
    network = rr.SeriesLines(
        names=["robots connected", "most hops", "mean hops"],
        colors=[palette.GREEN, palette.VERMILION, palette.SKY],
        widths=[2.5] * 3,
    )
    rec.log("plots/network", network, static=True)


def cell_names(config: RecorderConfig) -> list[str]:
    """Names that tell a cell from a robot where the scenario only numbers them."""
    return [f"Cell {cell.name}" if cell.name.isdigit() else cell.name for cell in config.search_cells]


def cell_colors(number: int) -> list[palette.Rgb]:
    """A search cell has one color, in the map and in the plot."""
    return [palette.CELL_COLORS[i % len(palette.CELL_COLORS)] for i in range(number)]


def _ui(points: float) -> Any:
    """A radius in points of the screen: as legible for 100 robots as for nine."""
    return rr.Radius.ui_points(points)


def _dots(radius_points: float, **fields: Any) -> rr.Points3D:
    return rr.Points3D.from_fields(radii=_ui(radius_points), point_shading=_FLAT, **fields)


def _names() -> rr.Points3D:
    """Points that only carry labels."""
    return rr.Points3D.from_fields(radii=_ui(0.5), colors=palette.LABEL, show_labels=True)


def _lines(radius_points: float, color: palette.Rgb) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(radii=_ui(radius_points), colors=color)
