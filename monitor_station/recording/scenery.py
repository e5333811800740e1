"""What never changes in a recording: floor plan, station, search cells, victims, and the styles of all that moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from monitor_station.config import RecorderConfig, cell_title
from monitor_station.recording import palette
from monitor_station.recording.stream import Stream
from monitor_station.recording.tiles import Tile

__all__ = ["Height", "lift", "name_offset_m", "write_static"]

LEGEND: Final = """\
**Map** white: explored and free, black: wall, dark: unknown; lighter: true rooms that the MS does not know yet.

**Dots** robots where the MS believes them: **orange** search (SR), **light blue** relay (RR), **purple** no route
to the MS. **Rim** a robot's true place: pale: all is well, **yellow** recovers a link, **dark blue** away on a sortie,
**purple** lost its path, **black** paused, **red** dead.

**Red line** chain from the farthest SR to the MS, **dark blue** all other next hops (NMS), **gray** trails.

**Green square** MS, **small orange dots** targets, **yellow** victim not found, **green** victim found.

In the blueprint panel (button at the top right) `network/range` shows each radio's reach.
"""


class Height:
    """z of each layer in metres; what matters more is higher."""

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


def name_offset_m(config: RecorderConfig) -> NDArray[np.float32]:
    """(2,) from a robot to the point of its name. The label hangs below it, clear of the dot at the first zoom."""
    return np.array([0.0, -0.008 * config.geometry.rows * config.geometry.resolution_m], np.float32)


_FLAT: Final = rr.components.PointShading.Flat


def write_static(stream: Stream, config: RecorderConfig, tiles: Sequence[Tile]) -> None:
    """Log what never changes: floor plan, places, sizes and styles."""
    _write_maps(stream, config, tiles)
    _write_places(stream, config)
    _write_moving(stream, config)
    _write_plots(stream, config)


def _write_maps(stream: Stream, config: RecorderConfig, tiles: Sequence[Tile]) -> None:
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
    stream.log_static("truth/map", plan)
    for tile in tiles:
        shape = rr.GridMap.from_fields(
            format=_image_format(tile.cols, tile.rows, "L"),
            cell_size=geometry.resolution_m,
            translation=(tile.x0_m, tile.y0_m, Height.MAP),
            colormap=rr.components.Colormap.RvizMap,
            draw_order=0.0,
        )
        stream.log_static(f"ms/map/{tile.name}", shape)


def _image_format(width: int, height: int, color_model: Literal["L", "RGBA"]) -> rr.components.ImageFormat:
    return rr.components.ImageFormat(width=width, height=height, color_model=color_model, channel_datatype="U8")


def _write_places(stream: Stream, config: RecorderConfig) -> None:
    """The station, the search cells and the victims."""
    x, y = config.station_m
    box = rr.Boxes3D(
        centers=[(x, y, Height.LINK)],
        half_sizes=[(0.9, 0.9, 0.05)],
        colors=palette.GREEN,
        fill_mode="solid",
    )
    stream.log_static("ms/station", box)
    name = rr.Points3D.from_fields(positions=[(x, y - 1.0, Height.LABEL)], labels=["MS"])
    stream.log_static("ms/station/name", name, _names())
    if config.cell_rectangles_m:
        outlines = [
            lift(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]), Height.TRAIL)
            for x0, y0, x1, y1 in config.cell_rectangles_m
        ]
        tops = np.array([((x0 + x1) / 2, y1) for x0, _, x1, y1 in config.cell_rectangles_m])
        colors = cell_colors(len(tops))
        stream.log_static("ms/cells/outline", rr.LineStrips3D(outlines, radii=_ui(2.0), colors=colors))
        stream.log_static("ms/cells", rr.Points3D.from_fields(positions=lift(tops, Height.LABEL)), _names())
    stream.log_static("ms/victims", _dots(6.0, colors=palette.FOUND))
    if len(config.victims_m):
        places = lift(config.victims_m, Height.TARGET)
        stream.log_static("truth/victims", _dots(6.0, colors=palette.NOT_FOUND, positions=places))


def _write_moving(stream: Stream, config: RecorderConfig) -> None:
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
        stream.log_static(path, style)
    states = rr.StateConfiguration(values=palette.STATE_NAMES, colors=palette.STATE_COLORS)
    for node in range(1, config.robots + 1):
        stream.log_static(f"network/state/{node}", states)


def _write_plots(stream: Stream, config: RecorderConfig) -> None:
    stream.log_static("legend", rr.TextDocument(LEGEND, media_type="text/markdown"))
    names = [cell_title(cell.name) for cell in config.search_cells]
    search = rr.SeriesLines(names=names, colors=cell_colors(len(names)), widths=[2.5] * len(names))
    stream.log_static("plots/search", search)
    network = rr.SeriesLines(
        names=["robots connected", "most hops", "mean hops"],
        colors=[palette.GREEN, palette.VERMILION, palette.SKY],
        widths=[2.5] * 3,
    )
    stream.log_static("plots/network", network)


def cell_colors(number: int) -> list[palette.Rgb]:
    """Colors of search cells, the same in the map and in the plot."""
    return [palette.CELL_COLORS[i % len(palette.CELL_COLORS)] for i in range(number)]


def _ui(points: float) -> Any:
    """A radius in points, independent of the zoom: 100 robots are as legible as nine."""
    return rr.Radius.ui_points(points)


def _dots(radius_points: float, **fields: Any) -> rr.Points3D:
    return rr.Points3D.from_fields(radii=_ui(radius_points), point_shading=_FLAT, **fields)


def _names() -> rr.Points3D:
    """Points that only carry labels."""
    return rr.Points3D.from_fields(radii=_ui(0.5), colors=palette.LABEL, show_labels=True)


def _lines(radius_points: float, color: palette.Rgb) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(radii=_ui(radius_points), colors=color)
