"""A made-up mission for tests of the recording: robots wander through three rooms, the map grows, one robot dies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from agents.messages import Table
from monitor_station.config import RecorderConfig, SearchCell
from monitor_station.recording.recorder import Recorder
from monitor_station.view import StationView
from world.feed import Event, Snapshot
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry
from world.terms import NOBODY, STATION, UNREACHABLE, Cls, Mode

STATION_M = (28.0, 35.0)
RANGE_M = 20.0
_ROOMS = (
    (24, 29, 34, 41), (26.5, 41, 29.5, 56), (5, 53, 29.5, 56), (5, 51, 8, 56), (4, 35.5, 22, 51), (26.5, 14, 29.5, 29),
    (5, 14, 29.5, 17), (5, 14, 8, 19), (4, 19, 22, 34.5), (34, 33.5, 50, 36.5), (47, 33.5, 50, 52), (33, 52, 50, 67.5),
)  # fmt: skip
CELLS_M = ((4.0, 35.5, 22.0, 51.0), (4.0, 19.0, 22.0, 34.5), (33.0, 52.0, 50.0, 67.5))


def recorder_config(robots: int) -> RecorderConfig:
    """The arena three_cells with four victims."""
    geometry = GridGeometry(140, 108)
    occupied = np.ones((140, 108), bool)
    for room in _ROOMS:
        occupied.flat[geometry.rectangle(*room)] = False
    cells = tuple(SearchCell(f"Cell {i + 1}", geometry.rectangle(*box)) for i, box in enumerate(CELLS_M))
    victims = np.array([(10.0, 45.0), (18.0, 25.0), (40.0, 60.0), (46.0, 64.0)])
    return RecorderConfig("synthetic", geometry, occupied, STATION_M, RANGE_M, robots, victims, cells, CELLS_M)


@dataclass(frozen=True, slots=True)
class Moment:
    """What the recorder gets at one tick."""

    snapshot: Snapshot
    view: StationView
    events: tuple[Event, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass
class Mission:
    """Robots that walk to random free places in straight steps, joined by a breadth-first tree of radio links."""

    robots: int
    seed: int = 1
    killed: int = 4
    kill_tick: int = 3_000
    config: RecorderConfig = field(init=False)
    map: NDArray[np.int8] = field(init=False)

    def __post_init__(self) -> None:
        self.config = recorder_config(self.robots)
        self.map = np.full(self.config.geometry.size, UNKNOWN, np.int8)
        # Free cells and the walls that face them: nobody sees the inside of a wall.
        self._visible = ndimage.binary_dilation(~self.config.occupied, np.ones((3, 3), bool))
        self._rng = np.random.default_rng(self.seed)
        self._xy = np.array(STATION_M) + self._rng.uniform(-3, 3, (self.robots, 2))
        self._goal = self._xy.copy()
        self._found: tuple[tuple[int, float, float], ...] = ()

    def moments(self, ticks: int) -> Iterator[Moment]:
        """Yield one `Moment` a tick."""
        for tick in range(ticks):
            present = np.ones(self.robots, np.uint8)
            if tick >= self.kill_tick:
                present[self.killed - 1] = 0
            if tick % 5 == 0:
                hops, nms = self._tree(present)
            self._walk(present)
            snapshot = self._snapshot(tick, present, hops, nms)
            yield Moment(snapshot, self._view(snapshot), tuple(self._events(tick)), tuple(self._tables(snapshot, tick)))

    def _walk(self, present: NDArray[np.uint8]) -> None:
        gap = self._goal - self._xy
        far = np.linalg.norm(gap, axis=1)
        arrived = far < 0.3
        picks = self._rng.choice(self.config.search_cells[0].cells, self.robots)
        for number in range(1, 3):
            other = self._rng.choice(self.config.search_cells[number].cells, self.robots)
            picks = np.where(self._rng.random(self.robots) < 0.4, other, picks)
        self._goal[arrived] = self.config.geometry.centers(picks[arrived])
        step = gap / np.maximum(far, 0.3)[:, None] * 0.028
        self._xy = self._xy + step * present[:, None]

    def _tree(self, present: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.int16]]:
        places = np.vstack((np.array(STATION_M), self._xy))
        near = np.linalg.norm(places[:, None] - places[None], axis=2) < RANGE_M * 0.6
        hops = np.full(self.robots + 1, UNREACHABLE, np.uint8)
        nms = np.full(self.robots + 1, NOBODY, np.int16)
        hops[0] = 0
        ring = [0]
        while ring:
            following = []
            for node in ring:
                for other in np.flatnonzero(near[node] & (hops == UNREACHABLE)).tolist():
                    if other and present[other - 1]:
                        hops[other], nms[other] = hops[node] + 1, node
                        following.append(other)
            ring = following
        return hops[1:], nms[1:]

    def _snapshot(
        self, tick: int, present: NDArray[np.uint8], hops: NDArray[np.uint8], nms: NDArray[np.int16]
    ) -> Snapshot:
        nodes = np.arange(1, self.robots + 1, dtype=np.int16)
        cls = np.where(np.isin(nodes, nms), Cls.RR, Cls.SR).astype(np.uint8)
        mode = np.where(hops == UNREACHABLE, Mode.LOST, Mode.WALK).astype(np.uint8)
        mode[(nodes + tick // 40) % 17 == 0] = Mode.INNER
        return Snapshot(
            tick, nodes, present, self._xy.copy(), cls, mode, hops, nms, np.full(self.robots, NOBODY, np.int16),
            self._goal.copy(),
        )  # fmt: skip

    def _view(self, snapshot: Snapshot) -> StationView:
        cells, values = self._explore(snapshot)
        for victim, (x, y) in enumerate(self.config.victims_m.tolist()):
            known = any(victim == found for found, _, _ in self._found)
            if not known and (np.linalg.norm(self._xy - (x, y), axis=1) < 4.0).any():
                self._found = (*self._found, (victim, x, y))
        rates = tuple(float((self.map[cell.cells] == FREE).mean()) for cell in self.config.search_cells)
        reachable = (snapshot.hops < UNREACHABLE) & (snapshot.present == 1)
        xy = snapshot.xy_m.astype(np.float32)
        return StationView(
            snapshot.tick, snapshot.nodes, xy, snapshot.cls, reachable, cells, values, self._found, rates
        )

    def _explore(self, snapshot: Snapshot) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
        """In each tick one robot explores a square of 8 m."""
        row = snapshot.tick % self.robots
        x, y = snapshot.xy_m[row]
        cells = self.config.geometry.rectangle(x - 4, y - 4, x + 4, y + 4)
        cells = cells[(self.map[cells] == UNKNOWN) & self._visible.flat[cells]]
        values = np.where(self.config.occupied.flat[cells], OCCUPIED, FREE).astype(np.int8)
        self.map[cells] = values
        return cells, values

    def _events(self, tick: int) -> Iterator[Event]:
        if tick == 0:
            yield Event(0, "mission", NOBODY, f"{self.robots} robots leave the monitor station")
        if tick == self.kill_tick:
            yield Event(tick, "fault", self.killed, f"robot {self.killed} was killed", {"verb": "kill"})
        if tick % 300 == 299:
            yield Event(tick, "link", 1 + tick % self.robots, f"robot {1 + tick % self.robots} changed its NMS")

    def _tables(self, snapshot: Snapshot, tick: int) -> Iterator[Table]:
        if tick % 10:
            return
        node = 1 + (tick // 10) % self.robots
        dst = np.arange(self.robots + 1, dtype=np.int16)
        row = node - 1
        hop = np.concatenate(([snapshot.hops[row]], np.abs(snapshot.hops.astype(int) - snapshot.hops[row]) + 1))
        xy = np.vstack((STATION_M, snapshot.xy_m)).astype(np.float32)
        inv = np.concatenate(([0], snapshot.nms == node)).astype(np.uint8)
        cls = np.concatenate(([STATION], snapshot.cls)).astype(np.uint8)
        keep = dst != node
        yield Table(
            tick, node, NOBODY, dst[keep], np.full(self.robots, snapshot.nms[row], np.int16),
            np.minimum(hop, 255).astype(np.uint8)[keep], xy[keep], inv[keep], cls[keep],
        )  # fmt: skip


def feed(recorder: Recorder, moments: list[Moment], dropped: range = range(0)) -> None:
    """Hand a mission over as the station process does: views every tick, the world's snapshots ten at a time."""
    waiting: list[Snapshot] = []
    for moment in moments:
        recorder.station(moment.view)
        if moment.snapshot.tick not in dropped:
            waiting.append(moment.snapshot)
        if len(waiting) == 10:
            _pass_on(recorder, waiting)
        for event in moment.events:
            recorder.event(event)
        for table in moment.tables:
            recorder.table(table)
    _pass_on(recorder, waiting)


def _pass_on(recorder: Recorder, waiting: list[Snapshot]) -> None:
    for snapshot in waiting:
        recorder.snapshot(snapshot)
    waiting.clear()


def record(mission: Mission, path: Path, ticks: int, dropped: range = range(0)) -> tuple[Recorder, list[Moment]]:
    """Record a mission and close the file."""
    moments = list(mission.moments(ticks))
    recorder = Recorder(mission.config, path)
    feed(recorder, moments, dropped)
    recorder.close()
    return recorder, moments
