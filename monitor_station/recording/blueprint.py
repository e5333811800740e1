"""The layout that a recording opens with: no click is needed to read it."""

from __future__ import annotations

import math
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from monitor_station.config import RecorderConfig
from monitor_station.recording import palette
from world.terms import TICK_S

GRAPH_SIZE: Final = (620.0, 230.0)
"""Width and height of the routing graph."""

FEW_ROBOTS: Final = 12
"""With up to so many robots, forwarding tables and the routing graph are shown as often as they change."""

_FIELD_OF_VIEW_DEG: Final = 55.0
_TRAIL_S: Final = 90.0


def build(config: RecorderConfig) -> rrb.Blueprint:
    """The map from above; beside it legend, progress, network and events; then routes, states and forwarding tables."""
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
            "ms/trails": _recent(_TRAIL_S if config.robots <= FEW_ROBOTS else _TRAIL_S / 4),
            "network/range": rrb.EntityBehavior(visible=False),
        },
    )


def _recent(length_s: float) -> rrb.VisibleTimeRanges:
    """The last seconds, on either timeline."""
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
    """From the start to a little after the cursor, where the viewer's default is 30 s."""
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
