"""What the MS knows, as the recording shows it under `ms/` and in the plot of search rates."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr

from bus.nodes import short_name
from monitor_station.config import RecorderConfig, cell_title
from monitor_station.recording import palette
from monitor_station.recording.scenery import Height, lift, name_offset_m
from monitor_station.recording.stream import Rows, Stream
from monitor_station.recording.tiles import MapTiles
from monitor_station.view import StationView
from world.terms import Cls

__all__ = ["Known"]

_NAME_EACH_TICKS: Final = 5
_SECOND_TICKS: Final = 10
_TRAIL_POINTS: Final = 6
"""Points of a piece of trail, one per second."""
_MOVED_M: Final = 0.1
"""A robot that moved less during a piece of trail leaves none."""


class Known:
    """Records the station's views, in the order of ticks."""

    def __init__(self, stream: Stream, config: RecorderConfig, tiles: MapTiles) -> None:
        self._stream, self._config = stream, config
        self._name_offset_m = name_offset_m(config)
        self._tiles = tiles
        self._tick = -1
        """Tick of the last view."""

        # Rows that wait to be sent.
        self._robots, self._names, self._rates = Rows(), Rows(), Rows()
        self._changed_tiles = {f"ms/map/{tile.name}": Rows() for tile in tiles.tiles}
        self._trail = Rows()
        """Positions of robots in the last seconds, one row per second."""

        # What the recording shows now; a change is logged.
        self._shown_robots = b""
        self._shown_names = 0
        self._shown_victims = 0
        self._shown_percents: tuple[int, ...] = ()

    def take(self, view: StationView) -> None:
        """Record what the MS knows at a tick."""
        self._tick = view.tick
        if len(view.robots):
            self._robots.add(view.tick, view.xy_m)
            if view.tick % _NAME_EACH_TICKS == 0:
                self._names.add(view.tick, view.xy_m + self._name_offset_m)
        key = view.robots.tobytes() + view.cls.tobytes() + view.reachable.tobytes()
        if key != self._shown_robots:
            self._shown_robots = key
            self._log_robots(view)
        if len(view.cells):
            self._tiles.apply(view.cells, view.values)
        if len(view.victims) != self._shown_victims:
            self._shown_victims = len(view.victims)
            self._log_victims(view)
        if view.tick % _SECOND_TICKS == 0:
            self._each_second(view)

    @property
    def held_ticks(self) -> int:
        """How many ticks wait to be sent."""
        return len(self._robots.ticks)

    def send(self) -> None:
        """Send all rows that wait."""
        for path, rows, z_m in (("ms/robots", self._robots, Height.ROBOT), ("ms/names", self._names, Height.LABEL)):
            if rows.ticks:
                self._stream.send(path, rows, rr.Points3D.columns(positions=lift(rows.joined(), z_m)))
        if self._rates.ticks:
            self._stream.send("plots/search", self._rates, rr.Scalars.columns(scalars=self._rates.joined()))
        for path, rows in self._changed_tiles.items():
            if rows.ticks:
                pixels = rr.GridMap.columns(data=np.stack(rows.values))
                self._stream.send(path, rows, pixels, lengths=[1] * len(rows.ticks))

    def close(self) -> None:
        """Send all rows that wait, and the map as it is now."""
        if self._tick >= 0:
            self._take_tiles(self._tick)
        self.send()

    def _each_second(self, view: StationView) -> None:
        self._rates.add(view.tick, np.array(view.search_rate))
        self._take_tiles(view.tick)
        percents = tuple(int(100 * rate) for rate in view.search_rate)
        if percents != self._shown_percents and len(self._config.cell_rectangles_m) == len(percents):
            self._shown_percents = percents
            cells = zip(self._config.search_cells, percents, strict=True)
            labels = [f"{cell_title(cell.name)}: {percent} %" for cell, percent in cells]
            self._stream.log(view.tick, "ms/cells", rr.Points3D.from_fields(labels=labels))
        trail = self._trail
        if trail.values and len(trail.values[-1]) != len(view.xy_m):
            trail.clear()
        trail.add(view.tick, view.xy_m)
        if len(trail.ticks) == _TRAIL_POINTS:
            self._log_trails(view.tick)

    def _take_tiles(self, tick: int) -> None:
        for tile, pixels in self._tiles.take():
            self._changed_tiles[f"ms/map/{tile.name}"].add(tick, np.frombuffer(pixels, np.uint8))

    def _log_robots(self, view: StationView) -> None:
        shades = np.array([palette.CLASS_COLORS[Cls.SR], palette.CLASS_COLORS[Cls.RR]], np.uint8)
        colors = np.where(view.reachable[:, None], shades[view.cls], np.array(palette.NO_CONTACT, np.uint8))
        self._stream.log(view.tick, "ms/robots", rr.Points3D.from_fields(colors=colors))
        if len(view.robots) != self._shown_names:
            self._shown_names = len(view.robots)
            labels = [short_name(node) for node in view.robots.tolist()]
            self._stream.log(view.tick, "ms/names", rr.Points3D.from_fields(labels=labels))

    def _log_victims(self, view: StationView) -> None:
        xy_m = np.array([(x, y) for _, x, y in view.victims]).reshape(-1, 2)
        self._stream.log(view.tick, "ms/victims", rr.Points3D.from_fields(positions=lift(xy_m, Height.VICTIM)))

    def _log_trails(self, tick: int) -> None:
        """Log the pieces of trail since the last time; the next ones begin where these end."""
        strips = lift(np.stack(self._trail.values, axis=1), Height.TRAIL)
        steps_m = np.abs(np.diff(strips[..., :2], axis=1)).sum(axis=(1, 2))
        last = self._trail.values[-1]
        self._trail.clear()
        self._trail.add(tick, last)
        moved = strips[steps_m > _MOVED_M]
        if len(moved):
            self._stream.log(tick, "ms/trails", rr.LineStrips3D.from_fields(strips=moved))
