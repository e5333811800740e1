"""What the network does (`network/`) and what is true (`truth/`), as the recording shows them."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from bus.nodes import short_name
from monitor_station.config import RecorderConfig
from monitor_station.recording import palette
from monitor_station.recording.blueprint import FEW_ROBOTS, GRAPH_SIZE
from monitor_station.recording.chain import farthest_chain, link_strips, parents, places, tree_layout
from monitor_station.recording.scenery import Height, lift, name_offset_m
from monitor_station.recording.states import DisplayedStates, State
from monitor_station.recording.stream import Rows, Stream
from world.feed import Event, Snapshot
from world.routes import hop_summary
from world.terms import STATION, UNREACHABLE, Cls, Mode

__all__ = ["Network"]

_REGULAR_TICKS: Final = 5
"""Interval of positions, links and the chain; a changed pointer is recorded at once."""
_SECOND_TICKS: Final = 10
_GRAPH_PAUSE_TICKS: Final = 50
"""Shortest interval between two graphs of many robots."""
_NEVER: Final = -1_000


class Network:
    """Records the world's snapshots, in the order of ticks."""

    def __init__(self, stream: Stream, config: RecorderConfig) -> None:
        self._stream, self._config = stream, config
        self._name_offset_m = name_offset_m(config)
        self._few = config.robots <= FEW_ROBOTS
        self._displayed = DisplayedStates()
        self._begun = False

        # Rows that wait to be sent.
        self._true, self._targets, self._ranges, self._hops = Rows(), Rows(), Rows(), Rows()
        self._links = Rows()
        """Each value is the strips, and the pointers of all robots."""
        self._chains = Rows()
        """Each value is the places of the chain's nodes, and their ids."""

        # What the recording shows now; a change is recorded.
        self._shown_chain: tuple[int, ...] = ()
        self._shown_pointers = b""
        self._shown_conduct = b""
        """Presence, classes and modes; empty while the recording does not show them all yet."""
        self._shown_states = np.full(config.robots, -1)
        self._shown_marks = False
        """Whether robots are marked as paused or dead."""
        self._shown_graph = b""
        self._graph_tick = _NEVER
        self._changes = [rr.StateChange(state=name) for name in palette.STATE_NAMES]

    def hear(self, event: Event) -> None:
        """Learn from an event who is paused."""
        if self._displayed.hear(event):
            self._shown_conduct = b""

    def take(self, snapshot: Snapshot) -> None:
        """Record what the world knows at the end of a tick."""
        tick = snapshot.tick
        pointers = snapshot.nms.tobytes() + snapshot.present.tobytes() + (snapshot.hops == UNREACHABLE).tobytes()
        moved = pointers != self._shown_pointers
        regular = not self._begun or tick % _REGULAR_TICKS == 0
        self._shown_pointers = pointers
        if regular or moved:
            self._links.add(tick, (link_strips(snapshot, self._config.station_m), snapshot.nms))
            self._add_chain(snapshot, regular)
        conduct = snapshot.present.tobytes() + snapshot.cls.tobytes() + snapshot.mode.tobytes()
        if moved or (conduct != self._shown_conduct and (regular or self._few)):
            states = self._displayed.update(snapshot)
            self._log_states(snapshot, states)
            self._log_graph(snapshot, states)
            # With many robots the graph lags behind, and must be looked at again.
            self._shown_conduct = conduct if self._few and self._displayed.settled else b""
        if regular:
            self._true.add(tick, snapshot.xy_m)
        if not self._begun or tick % _SECOND_TICKS == 0:
            self._each_second(snapshot)
        self._begun = True

    @property
    def held_ticks(self) -> int:
        """How many ticks wait to be sent."""
        return _REGULAR_TICKS * len(self._true.ticks)

    def send(self) -> None:
        """Send all rows that wait."""
        points = ("truth/robots", self._true, Height.RIM), ("network/targets", self._targets, Height.TARGET)
        for path, rows, z_m in points:
            if rows.ticks:
                self._stream.send(path, rows, rr.Points3D.columns(positions=lift(rows.joined(), z_m)))
        if self._ranges.ticks:
            centers = lift(self._ranges.joined(), Height.RIM)
            self._stream.send("network/range", self._ranges, rr.Cylinders3D.columns(centers=centers))
        if self._links.ticks:
            self._send_links()
        if self._chains.ticks:
            self._send_chains()
        if self._hops.ticks:
            self._stream.send("plots/network", self._hops, rr.Scalars.columns(scalars=self._hops.joined()))

    def _add_chain(self, snapshot: Snapshot, regular: bool) -> None:
        chain = farthest_chain(snapshot, self._config.station_m)
        if regular or chain != self._shown_chain:
            self._shown_chain = chain
            nodes = np.array(chain, np.int16)
            self._chains.add(snapshot.tick, (places(snapshot, nodes, self._config.station_m), nodes))

    def _each_second(self, snapshot: Snapshot) -> None:
        searching = (snapshot.mode == Mode.WALK) | (snapshot.mode == Mode.AWAY)
        walking = (snapshot.present == 1) & (snapshot.cls == Cls.SR) & searching
        self._targets.add(snapshot.tick, snapshot.target_m[walking])
        self._ranges.add(snapshot.tick, snapshot.xy_m[snapshot.present == 1])
        self._hops.add(snapshot.tick, np.array(hop_summary(snapshot), np.float64))

    def _log_states(self, snapshot: Snapshot, states: NDArray[np.int64]) -> None:
        changed = np.flatnonzero(states != self._shown_states)
        if not len(changed):
            return
        self._shown_states = states
        for row in changed:
            self._stream.log(snapshot.tick, f"network/state/{snapshot.nodes[row]}", self._changes[states[row]])
        rims = np.array(palette.RIM_COLORS, np.uint8)[states]
        radii = -np.array(palette.RIM_POINTS)[states]  # negative: in points
        self._stream.log(snapshot.tick, "truth/robots", rr.Points3D.from_fields(colors=rims, radii=radii))
        gone = np.flatnonzero(states >= State.PAUSED)
        if len(gone) or self._shown_marks:
            self._shown_marks = len(gone) > 0
            labels = [f"{snapshot.nodes[row]} {palette.STATE_NAMES[states[row]]}" for row in gone]
            above = lift(snapshot.xy_m[gone] - 4.5 * self._name_offset_m, Height.LABEL)
            marks = rr.Points3D.from_fields(positions=above, labels=labels)
            self._stream.log(snapshot.tick, "truth/gone", marks)

    def _log_graph(self, snapshot: Snapshot, states: NDArray[np.int64]) -> None:
        pause_ticks = 1 if self._few else _GRAPH_PAUSE_TICKS
        if snapshot.tick - self._graph_tick < pause_ticks:
            return
        key = self._shown_pointers + states.astype(np.uint8).tobytes()
        if key == self._shown_graph:
            return
        self._shown_graph, self._graph_tick = key, snapshot.tick
        nms = parents(snapshot)
        nodes = [STATION, *snapshot.nodes.tolist()]
        colors = np.vstack((np.array([palette.GREEN]), np.array(palette.STATE_COLORS)[states])).astype(np.uint8)
        names = [short_name(node) for node in nodes]
        spots = tree_layout(nodes, nms) * GRAPH_SIZE
        self._stream.log(
            snapshot.tick,
            "network/graph",
            rr.GraphNodes(names, positions=spots, colors=colors, labels=names),
            rr.GraphEdges([(short_name(a), short_name(b)) for a, b in nms.items()], graph_type="directed"),
        )

    def _send_links(self) -> None:
        strips, pointers = zip(*self._links.values, strict=True)
        nms = rr.AnyValues.columns(nms=np.concatenate(pointers)).partition([len(row) for row in pointers])
        drawn = rr.LineStrips3D.columns(strips=lift(np.concatenate(strips), Height.LINK))
        self._stream.send("network/links", self._links, drawn, nms, lengths=[len(row) for row in strips])

    def _send_chains(self) -> None:
        """One strip per row, with the ids of its nodes; none where there is no chain."""
        ways, ids = zip(*self._chains.values, strict=True)
        nodes = rr.AnyValues.columns(nodes=np.concatenate(ids)).partition([len(row) for row in ids])
        drawn = rr.LineStrips3D.columns(strips=[lift(row, Height.CHAIN) for row in ways if len(row)])
        self._stream.send("network/chain", self._chains, drawn, nodes, lengths=[min(len(row), 1) for row in ways])
