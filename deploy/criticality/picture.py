"""The picture of a mission's criticality: robots over time, and the same over the floor; as PNG and SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray

from deploy.criticality.verdict import WITHIN_S, Verdict
from deploy.scenario.arena import Arena

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw", "over_the_floor", "over_time"]

_STYLE: Final[Any] = {"font.size": 9, "svg.hashsalt": "vds", "svg.fonttype": "none"}
_COLORS: Final = "YlOrRd"
"""From light to dark in every kind of color vision."""
_SQUARES: Final = 30
"""Along the longer side of the floor."""

Row = Mapping[str, Any]


def draw(
    rows: Sequence[Row], verdict: Verdict, arena: Arena, every_s: float, title: str, verb: str, folder: Path
) -> list[Path]:
    """Draw; returns the files, PNG before SVG.

    Args:
        rows: one for each failure.
        verdict: on them.
        arena: of the mission.
        every_s: between the moments of failures.
        title: what mission it is.
        verb: what befell each robot.
        folder: where the files go.
    """
    with plt.rc_context(_STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 5.2), width_ratios=[1.5, 1.0], layout="constrained")
        most = max(1.0, *(row["cost_robot_s"] for row in rows))
        mesh = _draw_time(left, rows, verdict, every_s, most)
        _draw_floor(right, rows, arena, most)
        words = "robot-seconds without a path to the station"
        figure.colorbar(mesh, ax=[left, right], label=f"cost: {words}")
        happens = {"kill": "lose", "pause": "freeze", "restart": "restart"}[verb]
        mission = title.replace("$", r"\$")
        figure.suptitle(f"What would it cost to {happens} this robot at this moment?   ({mission})\n{verdict.words}")
        try:
            return [_save(figure, folder / f"criticality.{kind}") for kind in ("png", "svg")]
        finally:
            plt.close(figure)


def over_time(rows: Sequence[Row], every_s: float) -> tuple[list[int], NDArray[np.float64]]:
    """The robots, and (robots, moments) cost, NaN where a robot could not fail; moment k is at (k + 1) every_s."""
    robots = sorted({row["robot"] for row in rows})
    moments = max(round(row["at_s"] / every_s) for row in rows)
    cost = np.full((len(robots), moments), np.nan)
    for row in rows:
        cost[robots.index(row["robot"]), round(row["at_s"] / every_s) - 1] = row["cost_robot_s"]
    return robots, cost


def over_the_floor(rows: Sequence[Row], arena: Arena) -> tuple[float, NDArray[np.float64]]:
    """Side of a square in metres, and (rows, cols) mean cost of the failures in each, NaN where there was none."""
    geometry = arena.geometry
    width_m, height_m = geometry.cols * geometry.resolution_m, geometry.rows * geometry.resolution_m
    side_m = max(geometry.resolution_m, max(width_m, height_m) / _SQUARES)
    shape = int(np.ceil(height_m / side_m)), int(np.ceil(width_m / side_m))
    left_m, low_m = _corner(arena)
    total, count = np.zeros(shape), np.zeros(shape)
    for row in rows:
        at = int((row["y_m"] - low_m) / side_m), int((row["x_m"] - left_m) / side_m)
        total[at] += row["cost_robot_s"]
        count[at] += 1
    return side_m, np.divide(total, count, out=np.full(shape, np.nan), where=count > 0)


def _corner(arena: Arena) -> tuple[float, float]:
    x, y = arena.geometry.center(0)
    half = arena.geometry.resolution_m / 2
    return x - half, y - half


def _draw_time(axis: Axes, rows: Sequence[Row], verdict: Verdict, every_s: float, most: float) -> Any:
    robots, cost = over_time(rows, every_s)
    edges_s = (np.arange(cost.shape[1] + 1) + 0.5) * every_s
    mesh = axis.pcolormesh(edges_s, np.arange(len(robots) + 1) - 0.5, cost, cmap=_COLORS, vmin=0.0, vmax=most)
    axis.set_facecolor("0.85")
    if verdict.harmful:
        times_s = [row["at_s"] for row in verdict.harmful]
        lanes = [robots.index(row["robot"]) for row in verdict.harmful]
        axis.plot(times_s, lanes, "k.", ms=5, label=f"not everybody back within {WITHIN_S:g} s")
        axis.legend(loc="upper left", bbox_to_anchor=(0.0, -0.1), frameon=False)
    axis.set_yticks(range(len(robots)), [str(robot) for robot in robots])
    axis.set_ylabel("robot")
    axis.set_xlabel("time of the failure (s); grey: the robot is not there, or was not tried")
    axis.set_title("Who is critical, and when")
    return mesh


def _draw_floor(axis: Axes, rows: Sequence[Row], arena: Arena, most: float) -> None:
    side_m, cost = over_the_floor(rows, arena)
    left_m, low_m = _corner(arena)
    geometry = arena.geometry
    extent = (
        left_m, left_m + geometry.cols * geometry.resolution_m, low_m, low_m + geometry.rows * geometry.resolution_m,
    )  # fmt: skip
    axis.imshow(np.where(arena.occupied, 0.55, 1.0), cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)
    x, y = left_m + np.arange(cost.shape[1] + 1) * side_m, low_m + np.arange(cost.shape[0] + 1) * side_m
    axis.pcolormesh(x, y, cost, cmap=_COLORS, vmin=0.0, vmax=most, alpha=0.9)
    axis.plot(*arena.station_m, marker="*", ms=12, color="#0072B2", mec="white", ls="")
    axis.annotate("station", arena.station_m, xytext=(6, 4), textcoords="offset points", color="#0072B2")
    axis.set_xlim(extent[0], extent[1])
    axis.set_ylim(extent[2], extent[3])
    axis.set_aspect("equal")
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.set_title("Where a loss is expensive (mean)")


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=130, bbox_inches="tight", metadata={"Date": None} if path.suffix == ".svg" else None)
    return path
