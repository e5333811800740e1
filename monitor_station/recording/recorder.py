"""Writes the recording: what the MS knows (`ms/`), what the network does (`network/`), what is true (`truth/`).

Positions, lines, map tiles and tables are gathered for a moment and sent as columns: chunks, not data, set a
recording's size and cost. What changes rarely is logged as it changes, at its exact tick. Every call must come from one
thread.
"""

from __future__ import annotations

import time
from itertools import chain as joined
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from agents.messages import Table
from bus.nodes import short_name
from monitor_station.config import RecorderConfig
from monitor_station.recording import blueprint, palette
from monitor_station.recording.blueprint import Height, lift
from monitor_station.recording.chain import farthest_chain, hop_summary, link_strips, parents, places, tree_layout
from monitor_station.recording.states import State, SteadyStates, states_of
from monitor_station.recording.table_text import table_key, table_markdown
from monitor_station.recording.tiles import MapTiles
from monitor_station.view import StationView
from world.feed import Event, Snapshot
from world.terms import NOBODY, STATION, UNREACHABLE, Cls, Mode

_TICK_NS: Final = 100_000_000
_HELD_TICKS: Final = 500
_HELD_WALL_S: Final = 1.5
"""Rows are sent after so many ticks or so much wall time: the latter bounds what a crash loses."""

_BATCH_S: Final = 1.8
"""Wall time after which what was logged one by one is sent: a crash may lose two seconds."""

_FEW_ROBOTS: Final = 12
"""Up to here tables and graph are shown as often as they change."""


_EVENT_PATHS: Final = {"fault": "fault", "drop": "fault", "recovery": "fault", "link": "link", "role": "link"}


class Rows:
    """Rows of one entity that wait to be sent: a tick and one array each, the values of which are a list in the row.

    Those of `Wholes` are one value each.
    """

    def __init__(self) -> None:
        self.ticks: list[int] = []
        self.values: list[Any] = []
        self.extra: list[NDArray[Any]] = []

    def add(self, tick: int, value: Any, extra: NDArray[Any] | None = None) -> None:
        self.ticks.append(tick)
        self.values.append(value)
        if extra is not None:
            self.extra.append(extra)

    def clear(self) -> None:
        self.ticks.clear()
        self.values.clear()
        self.extra.clear()

    @property
    def lengths(self) -> list[int]:
        return [len(value) for value in self.values]


class Wholes(Rows):
    """Rows whose value is one, such as a document."""

    @property
    def lengths(self) -> list[int]:
        return [1] * len(self.values)


def _times(ticks: list[int]) -> tuple[rr.TimeColumn, rr.TimeColumn]:
    numbers = np.array(ticks, np.int64)
    return rr.TimeColumn("tick", sequence=numbers), rr.TimeColumn(
        "sim_time", duration=(numbers * _TICK_NS).astype("timedelta64[ns]")
    )


class Recorder:
    """One recording file, and on demand a live view of it on the loopback interface."""

    def __init__(self, config: RecorderConfig, path: Path, *, live_port: int | None = None) -> None:
        """Open the file and write what never changes.

        Raises:
            OSError: the file cannot be written.
        """
        path.open("wb").close()
        self._config = config
        self._rec = rr.RecordingStream(
            "vds",
            recording_id=config.recording_id or None,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=_BATCH_S, flush_num_bytes=8 << 20),
        )
        self._rec.set_log_time_enabled(False)
        self._rec.set_log_tick_enabled(False)
        sinks: list[Any] = [rr.FileSink(path)]
        if live_port is not None:
            sinks.append(rr.GrpcServerSink(bind_ip="127.0.0.1", port=live_port, server_memory_limit="512MiB"))
        self._rec.set_sinks(*sinks, default_blueprint=blueprint.build(config))
        self._rec.send_recording_name(config.run)
        self._closed = False
        self._sent_s = time.monotonic()
        self._logged_tick = -1
        self._few = config.robots <= _FEW_ROBOTS

        self._tiles = MapTiles(config.geometry)
        self._seen_rows, self._names, self._rates, self._trail = Rows(), Rows(), Rows(), Rows()
        self._tile_rows = {f"ms/map/{tile.name}": Wholes() for tile in self._tiles.tiles}
        self._documents: dict[str, Wholes] = {}
        # A label hangs below its point: this keeps it clear of the robot's dot at the first view's scale.
        self._name_offset_m = np.array([0.0, -0.008 * config.geometry.rows * config.geometry.resolution_m], np.float32)
        self._seen_tick = -1
        self._seen_key = b""
        self._named = self._victims = 0
        self._percents: tuple[int, ...] = ()

        self.dropped_ticks = 0
        """Ticks of the world's feed that never came; each gap is marked in `events/fault`."""
        self._last: Snapshot | None = None
        self._true_rows, self._links, self._chains = Rows(), Rows(), Rows()
        self._targets, self._ranges, self._hops = Rows(), Rows(), Rows()
        self._changes = [rr.StateChange(state=name) for name in palette.STATE_NAMES]
        self._chain: tuple[int, ...] = ()
        self._gone = False
        self._pointers = b""
        self._quiet = b""
        """Presence, classes and modes, while all that they mean is shown."""
        self._states = np.full(config.robots, -1)
        self._steady = SteadyStates(config.robots)
        self._graph_key = b""
        self._graph_tick = -1_000
        self._paused: set[int] = set()
        self._tables: dict[int, tuple[int, bytes]] = {}
        blueprint.write_static(self._rec, config, self._tiles.tiles)
        for tile in self._tiles.tiles:
            self._log(0, f"ms/map/{tile.name}", rr.GridMap.from_fields(data=self._tiles.pixels(tile)))

    # What the MS knows

    def station(self, view: StationView) -> None:
        """Take what the MS knows at a tick."""
        self._seen_tick = view.tick
        if len(view.robots):
            self._seen_rows.add(view.tick, view.xy_m)
            if view.tick % 5 == 0:
                self._names.add(view.tick, view.xy_m + self._name_offset_m)
        key = view.robots.tobytes() + view.cls.tobytes() + view.reachable.tobytes()
        if key != self._seen_key:
            self._seen_key = key
            self._log_robots(view)
        if len(view.cells):
            self._tiles.apply(view.cells, view.values)
        if len(view.victims) != self._victims:
            self._victims = len(view.victims)
            self._log_victims(view)
        if view.tick % 10 == 0:
            self._each_second(view)
        self._send_when_due()

    def _each_second(self, view: StationView) -> None:
        self._rates.add(view.tick, np.array(view.search_rate))
        self._log_map(view.tick)
        percents = tuple(int(100 * rate) for rate in view.search_rate)
        if percents != self._percents and len(self._config.cell_rectangles_m) == len(percents):
            self._percents = percents
            names = blueprint.cell_names(self._config)
            labels = [f"{name}: {percent} %" for name, percent in zip(names, percents, strict=True)]
            self._log(view.tick, "ms/cells", rr.Points3D.from_fields(labels=labels))
        trail = self._trail
        if trail.values and len(trail.values[-1]) != len(view.xy_m):
            trail.clear()
        trail.add(view.tick, view.xy_m)
        if len(trail.ticks) > 5:
            self._log_trails(view.tick)

    def _log_map(self, tick: int) -> None:
        for tile, pixels in self._tiles.take():
            self._tile_rows[f"ms/map/{tile.name}"].add(tick, np.frombuffer(pixels, np.uint8))

    def _log_robots(self, view: StationView) -> None:
        reached = view.reachable.astype(bool)
        shades = np.array([palette.CLASS_COLORS[Cls.SR], palette.CLASS_COLORS[Cls.RR]], np.uint8)
        colors = np.where(reached[:, None], shades[np.minimum(view.cls, 1)], np.array(palette.NO_CONTACT, np.uint8))
        self._log(view.tick, "ms/robots", rr.Points3D.from_fields(colors=colors))
        if len(view.robots) != self._named:
            self._named = len(view.robots)
            labels = [short_name(node) for node in view.robots.tolist()]
            self._log(view.tick, "ms/names", rr.Points3D.from_fields(labels=labels))

    def _log_victims(self, view: StationView) -> None:
        places = np.array([(x, y) for _, x, y in view.victims]).reshape(-1, 2)
        self._log(view.tick, "ms/victims", rr.Points3D.from_fields(positions=lift(places, Height.VICTIM)))

    def _log_trails(self, tick: int) -> None:
        strips = lift(np.stack(self._trail.values, axis=1), Height.TRAIL)
        steps = np.abs(np.diff(strips[..., :2], axis=1)).sum(axis=(1, 2))
        last = self._trail.values[-1]
        self._trail.clear()
        self._trail.add(tick, last)
        moved = strips[steps > 0.1]
        if len(moved):
            self._log(tick, "ms/trails", rr.LineStrips3D.from_fields(strips=moved))

    # What the network does, and what is true

    def snapshot(self, snapshot: Snapshot) -> None:
        """Take what the world knows at the end of a tick; ticks that are missing are marked, old ones ignored."""
        tick = snapshot.tick
        if self._last is not None:
            if tick <= self._last.tick:
                return
            if tick > self._last.tick + 1:
                self._mark_gap(self._last.tick + 1, tick)
        first = self._last is None
        self._last = snapshot
        if first:
            self._states = np.full(len(snapshot.nodes), -1)
            self._steady = SteadyStates(len(snapshot.nodes))
        pointers = snapshot.nms.tobytes() + snapshot.present.tobytes() + (snapshot.hops == UNREACHABLE).tobytes()
        regular = first or tick % 5 == 0
        moved = pointers != self._pointers
        self._pointers = pointers
        if regular or moved:
            self._links.add(tick, link_strips(snapshot, self._config.station_m), snapshot.nms)
            self._add_chain(snapshot, regular)
        conduct = snapshot.present.tobytes() + snapshot.cls.tobytes() + snapshot.mode.tobytes()
        if moved or (conduct != self._quiet and (regular or self._few)):
            states = self._steady.update(tick, states_of(snapshot, self._paused))
            self._log_states(snapshot, states)
            self._log_graph(snapshot, states)
            # With many robots the graph lags behind, and must be looked at again.
            self._quiet = conduct if self._few and self._steady.settled else b""
        if regular:
            self._true_rows.add(tick, snapshot.xy_m)
        if first or tick % 10 == 0:
            self._add_targets(snapshot)
            self._hops.add(tick, hop_summary(snapshot))
        self._send_when_due()

    def _add_chain(self, snapshot: Snapshot, regular: bool) -> None:
        chain = farthest_chain(snapshot, self._config.station_m)
        if regular or chain != self._chain:
            self._chain = chain
            nodes = np.array(chain, np.int16)
            self._chains.add(snapshot.tick, places(snapshot, nodes, self._config.station_m), nodes)

    def _mark_gap(self, start: int, end: int) -> None:
        self.dropped_ticks += end - start
        text = f"{end - start} ticks of the world's feed were dropped ({self.dropped_ticks} so far)"
        self.event(Event(start, "drop", NOBODY, text))

    def _add_targets(self, snapshot: Snapshot) -> None:
        shown = (snapshot.present == 1) & (snapshot.cls == Cls.SR) & (snapshot.mode == Mode.WALK)
        self._targets.add(snapshot.tick, snapshot.target_m[shown])
        self._ranges.add(snapshot.tick, snapshot.xy_m[snapshot.present == 1])

    def _log_states(self, snapshot: Snapshot, states: NDArray[np.int64]) -> None:
        changed = np.flatnonzero(states != self._states)
        if not len(changed):
            return
        self._states = states
        for row in changed:
            self._log(snapshot.tick, f"network/state/{snapshot.nodes[row]}", self._changes[states[row]])
        rims = np.array(palette.RIM_COLORS, np.uint8)[states]
        radii = -np.array(palette.RIM_POINTS)[states]  # negative: in points of the screen
        self._log(snapshot.tick, "truth/robots", rr.Points3D.from_fields(colors=rims, radii=radii))
        gone = np.flatnonzero(states >= State.PAUSED)
        if len(gone) or self._gone:
            self._gone = len(gone) > 0
            labels = [f"{snapshot.nodes[row]} {palette.STATE_NAMES[states[row]]}" for row in gone]
            above = lift(snapshot.xy_m[gone] - 4.5 * self._name_offset_m, Height.LABEL)
            marks = rr.Points3D.from_fields(positions=above, labels=labels)
            self._log(snapshot.tick, "truth/gone", marks)

    def _log_graph(self, snapshot: Snapshot, states: NDArray[np.int64]) -> None:
        pause = 1 if self._few else 50
        if snapshot.tick - self._graph_tick < pause:
            return
        key = self._pointers + states.astype(np.uint8).tobytes()
        if key == self._graph_key:
            return
        self._graph_key, self._graph_tick = key, snapshot.tick
        nms = parents(snapshot)
        nodes = [STATION, *snapshot.nodes.tolist()]
        colors = np.vstack((np.array([palette.GREEN]), np.array(palette.STATE_COLORS)[states])).astype(np.uint8)
        names = [short_name(node) for node in nodes]
        spots = tree_layout(nodes, nms) * blueprint.GRAPH_SIZE
        self._log(
            snapshot.tick,
            "network/graph",
            rr.GraphNodes(names, positions=spots, colors=colors, labels=names),
            rr.GraphEdges([(short_name(a), short_name(b)) for a, b in nms.items()], graph_type="directed"),
        )

    # What happens

    def event(self, event: Event) -> None:
        """Write a line into the log of the mission, of the links or of the faults."""
        if event.kind == "fault":
            if event.data.get("verb") == "pause" or event.data.get("cause") == "unresponsive":
                self._paused.add(event.node)
            else:
                self._paused.discard(event.node)
            self._quiet = b""
        where = _EVENT_PATHS.get(event.kind, "mission")
        level = "WARN" if where == "fault" else "INFO"
        self._log(event.tick, f"events/{where}", rr.TextLog(event.text, level=level))

    def table(self, table: Table) -> None:
        """Show a robot's forwarding table, unless only locations changed or the last is too young."""
        tick, known = self._tables.get(table.node, (-100_000, b""))
        if table.tick - tick < (10 if self._few else 600):
            return
        key = table_key(table)
        if key == known:
            return
        self._tables[table.node] = (table.tick, key)
        self._documents.setdefault(f"network/table/{table.node}", Wholes()).add(table.tick, table_markdown(table))

    # Sending

    def _log(self, tick: int, path: str, *what: Any) -> None:
        if tick != self._logged_tick:
            self._logged_tick = tick
            self._rec.set_time("tick", sequence=tick)
            self._rec.set_time("sim_time", duration=np.timedelta64(tick * _TICK_NS, "ns"))
        self._rec.log(path, *what)

    def _send_when_due(self) -> None:
        held = max(len(self._seen_rows.ticks), 5 * len(self._true_rows.ticks))
        if held >= _HELD_TICKS or time.monotonic() - self._sent_s > _HELD_WALL_S:
            self.send()

    def send(self) -> None:
        """Send all rows that wait."""
        self._sent_s = time.monotonic()
        self._send_points("ms/robots", self._seen_rows, Height.ROBOT)
        self._send_points("ms/names", self._names, Height.LABEL)
        self._send_points("truth/robots", self._true_rows, Height.RIM)
        self._send_points("network/targets", self._targets, Height.TARGET)
        if self._ranges.ticks:
            centers = lift(np.concatenate(self._ranges.values), Height.RIM)
            self._columns("network/range", self._ranges, rr.Cylinders3D.columns(centers=centers))
        self._send_links()
        self._send_chains()
        for path, rows in (("plots/search", self._rates), ("plots/network", self._hops)):
            if rows.ticks:
                self._columns(path, rows, rr.Scalars.columns(scalars=np.concatenate(rows.values)))
        for path, rows in self._tile_rows.items():
            if rows.ticks:
                self._columns(path, rows, rr.GridMap.columns(data=np.stack(rows.values)))
        for path, rows in self._documents.items():
            if rows.ticks:
                kinds = [rr.MediaType.MARKDOWN] * len(rows.ticks)
                self._columns(path, rows, rr.TextDocument.columns(text=rows.values, media_type=kinds))

    def _send_points(self, path: str, rows: Rows, z_m: float) -> None:
        if rows.ticks:
            self._columns(path, rows, rr.Points3D.columns(positions=lift(np.concatenate(rows.values), z_m)))

    def _send_links(self) -> None:
        rows = self._links
        if rows.ticks:
            pointers = rr.AnyValues.columns(nms=np.concatenate(rows.extra)).partition([len(row) for row in rows.extra])
            strips = lift(np.concatenate(rows.values), Height.LINK)
            self._columns("network/links", rows, rr.LineStrips3D.columns(strips=strips), pointers)

    def _send_chains(self) -> None:
        """One strip a row, none where there is no chain; the ids of its nodes go with it."""
        rows = self._chains
        if rows.ticks:
            nodes = rr.AnyValues.columns(nodes=np.concatenate(rows.extra)).partition([len(row) for row in rows.extra])
            strips = [lift(row, Height.CHAIN) for row in rows.values if len(row)]
            rows.values = [row[:1] for row in rows.values]
            self._columns("network/chain", rows, rr.LineStrips3D.columns(strips=strips), nodes)

    def _columns(self, path: str, rows: Rows, first: rr.ComponentColumnList, *more: rr.ComponentColumnList) -> None:
        """Send the rows as one chunk and forget them; `first` is cut into the rows' lengths."""
        columns = joined(first.partition(rows.lengths), *more)
        rr.send_columns(path, _times(rows.ticks), columns, recording=self._rec)
        rows.clear()

    def close(self) -> None:
        """Write everything that waits and the file's footer; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        if self._seen_tick >= 0:
            self._log_map(self._seen_tick)
        self.send()
        self._rec.flush()
        self._rec.disconnect()
