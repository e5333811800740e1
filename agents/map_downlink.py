"""The merged map on its way down: each node hands the MS's numbered changes to children that lag [paper 7.6]."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import _cells
from agents.evidence import SensorModel
from agents.messages import MapChunk
from agents.neighbors import Neighbors
from agents.room import Room
from bus.codec import WireError
from medium.messages import BROADCAST, Frame

_PATIENCE_TICKS: Final = 4
"""A child's update shows two ticks after a chunk was sent that it arrived; after this long the chunk is sent again."""
_LIMITED_PATIENCE_TICKS: Final = 10
"""The same where bandwidth is limited: a child may not send an update in every tick."""
_FEWEST_CHANGES: Final = 40
"""A frame has at least so many where bandwidth is limited, if a share has room for them and the child lacks them."""


class MapDownlink:
    """All changes of the MS's map that a node holds, in the MS's order and without a gap."""

    def __init__(self, chunk_cells: int) -> None:
        self._chunk_cells = chunk_cells
        self._cells: NDArray[np.uint32] = np.zeros(1024, np.uint32)
        self._odds: NDArray[np.int8] = np.zeros(1024, np.int8)
        self.version = 0
        """Number of changes held."""
        self._sent: dict[int, tuple[int, int]] = {}

    def append(self, cells: NDArray[np.uint32], odds: NDArray[np.int8]) -> None:
        """Add the next changes."""
        end = self.version + len(cells)
        if end > len(self._cells):
            room = max(end, 2 * len(self._cells)) - len(self._cells)
            self._cells = np.concatenate((self._cells, np.zeros(room, np.uint32)))
            self._odds = np.concatenate((self._odds, np.zeros(room, np.int8)))
        self._cells[self.version : end] = cells
        self._odds[self.version : end] = odds
        self.version = end

    def due(self, tick: int, children: list[int], neighbors: Neighbors, room: Room) -> list[Frame]:
        """A frame for each child that lags; with a limited radio as many as fit, for all who hear them."""
        if room.limited:
            return self._due_to_all(tick, children, neighbors, room)
        out = []
        encoded: dict[int, bytes] = {}
        for child in children:
            start = self._start(tick, child, neighbors, _PATIENCE_TICKS)
            if start >= self.version:
                continue
            end = min(start + self._chunk_cells, self.version)
            if start not in encoded:
                encoded[start] = self._encoded(start, end)
            out.append((child, encoded[start]))
            self._sent[child] = (end, tick)
        return out

    def _due_to_all(self, tick: int, children: list[int], neighbors: Neighbors, room: Room) -> list[Frame]:
        """Each frame helps every child whose next change is in it. Who was sent to least lately comes first."""
        starts = {child: self._start(tick, child, neighbors, _LIMITED_PATIENCE_TICKS) for child in children}
        out: list[Frame] = []
        for child in sorted(children, key=lambda child: self._sent.get(child, (0, -1))[1]):
            start = starts[child]
            fits = (room.left - MapChunk.HEAD_BYTES) // MapChunk.CHANGE_BYTES
            end = min(start + min(self._chunk_cells, fits), self.version)
            fewest = min(_FEWEST_CHANGES, room.share // MapChunk.CHANGE_BYTES, self.version - start)
            if end - start < max(fewest, 1):
                continue
            payload = self._encoded(start, end)
            room.take(len(payload))
            out.append((BROADCAST, payload))
            for other, first in starts.items():
                if start <= first < end:
                    starts[other] = end
                    self._sent[other] = (end, tick)
        return out

    def _start(self, tick: int, child: int, neighbors: Neighbors, patience: int) -> int:
        """The first change that a child lacks, as far as is known."""
        start = neighbors.by_id[child].map_version
        sent_to, sent_tick = self._sent.get(child, (0, -patience))
        return max(start, sent_to) if tick - sent_tick < patience else start

    def _encoded(self, start: int, end: int) -> bytes:
        return MapChunk(start, self._cells[start:end], self._odds[start:end]).encode()


class MapCopy(MapDownlink):
    """The changes that a robot has heard of."""

    def __init__(self, chunk_cells: int, sensors: SensorModel) -> None:
        super().__init__(chunk_cells)
        self._map = sensors.first_odds()
        """The MS's odds of all cells, as of the last change that is held."""
        self._settled = sensors.settled

    def receive(self, chunk: MapChunk) -> tuple[NDArray[np.uint32], NDArray[np.int8]]:
        """Take a chunk; returns the new changes, none of them if the chunk would leave a gap.

        Raises:
            WireError: a change that the MS did not make: outside the grid, to odds that can't be, or to none other.
        """
        known = self.version - chunk.first
        if known < 0 or known >= len(chunk.cells):
            return chunk.cells[:0], chunk.odds[:0]
        cells, odds = chunk.cells[known:], chunk.odds[known:]
        if not _cells.carry_out(self._map, cells, odds, self._settled):
            raise WireError("a change of the map that changes nothing, or of no cell, or to what no cell can be")
        self.append(cells, odds)
        return cells, odds
