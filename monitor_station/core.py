"""The core of the monitor station: a DSDV node that does not move, merges scans and distributes the merged map."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents.announcer import Announcer
from agents.dsdv import Router
from agents.map_downlink import MapDownlink
from agents.messages import MAP_CHUNK, SCAN_REPORT, MapChunk, ScanReport
from agents.payloads import sort_payloads
from agents.room import Room
from bus.codec import WireError
from medium.messages import BROADCAST, Frame, Inbox
from monitor_station.config import StationConfig
from monitor_station.exhaustion import Exhaustion
from monitor_station.map_merger import MapMerger
from monitor_station.search_rate import SearchRate
from monitor_station.view import StationView
from world.messages import Report, Sense
from world.terms import NOBODY, Cls

_RECORD: Final = struct.Struct("<II")
"""Head of a record of the journal: the tick at which a report was merged, and its length."""


_NONE: Final = np.zeros(0, np.int64)


class Station:
    """Sans-IO. All that it knows came over the radio. The journal lets a new incarnation go on where the last ended."""

    def __init__(self, config: StationConfig, rng: random.Random, incarnation: int, first_tick: int) -> None:
        node = config.node
        quiet_until = node.rules.routing.quiet_until(incarnation, first_tick)
        self.config = config
        self.router = Router(node, rng, quiet_until)
        self._announcer = Announcer(self.router)
        self.merger = MapMerger(node)
        self.downlink = MapDownlink(node.rules.reporting.chunk_cells)
        self.search = SearchRate(config)
        self.exhaustion = Exhaustion(node.geometry, node.station_m)
        known = np.flatnonzero(self.merger.cells >= 0)
        self.search.update(0, known, self.merger.cells[known])
        self.bad_frames = 0
        self._tick = first_tick
        self._merged_tick: dict[tuple[int, int, int], int] = {}
        """By robot, incarnation and number of a report."""
        self._journal: list[bytes] = []
        self._turned = known
        """Cells whose state changed in this tick, perhaps one twice."""

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Report]:
        """One tick; `inbox` is None at the first one after (re)joining."""
        tick = self._tick = sense.tick
        self._journal.clear()
        reports: list[ScanReport] = []
        handlers: dict[int, Callable[[bytes], object]] = {
            SCAN_REPORT: lambda payload: reports.append(ScanReport.decode(payload)),
            # The own map comes back where robots with a limited radio pass it on to all who hear them.
            MAP_CHUNK: MapChunk.decode,
        }
        updates, bad = sort_payloads(inbox, handlers)
        self.bad_frames += bad
        turned = [self._merge(tick, report) for report in reports]
        if turned or not sense.first:
            self._turned = np.concatenate([_NONE, *turned])
        self.router.step(tick, updates)
        here = sense.x_m, sense.y_m
        self.router.announce_self(tick, here, Cls.RR, here)
        report = Report(
            tick, self.search.searched, self.search.rates, self.merger.merged, tuple(sorted(self.merger.victims)),
            silent=tick < self.router.quiet_until, exhausted=self.exhaustion.step(tick, self.merger.cells),
        )  # fmt: skip
        return self._frames(tick, Room(inbox, limited=self.config.node.bandwidth_limited)), report

    def _merge(self, tick: int, report: ScanReport) -> NDArray[np.int64]:
        """Merge a report; returns the cells whose state changed."""
        try:
            self.router.limits.check_report(report, tick)
        except WireError:
            self.bad_frames += 1
            return _NONE
        change = self.merger.take(report)
        if change is None:
            return _NONE
        self._merged_tick.setdefault((report.origin, report.incarnation, report.number), tick)
        payload = report.encode()
        self._journal.append(_RECORD.pack(tick, len(payload)) + payload)
        self.downlink.append(change.cells.astype(np.uint32), change.odds)
        self.search.update(tick, change.turned, self.merger.cells[change.turned])
        return change.turned

    def _frames(self, tick: int, room: Room) -> tuple[Frame, ...]:
        router = self.router
        if tick < router.quiet_until:
            return ()
        version = self.downlink.version
        acks = self.merger.acks(), version, self.merger.ahead() if room.limited else b""
        update = self._announcer.update(tick, NOBODY, NOBODY, version, acks, room)
        frames: list[Frame] = [] if update is None else [(BROADCAST, update)]
        frames += self.downlink.due(tick, router.inv, router.neighbors, room)
        return tuple(frames)

    def view(self) -> StationView:
        """What the operators know after the step of this tick."""
        table = self.router.table
        ids = sorted(dst for dst in table.known if dst != self.router.node)
        victims = tuple((victim, x, y) for victim, (x, y) in sorted(self.merger.victims.items()))
        return StationView(
            self._tick,
            np.array(ids, np.int16),
            np.array([table.location_m(dst) for dst in ids], np.float32).reshape(-1, 2),
            np.array([table.cls(dst) for dst in ids], np.uint8),
            np.array([table.next_hop_to(dst) != NOBODY for dst in ids], np.bool_),
            self._turned,
            self.merger.cells[self._turned],
            victims,
            self.search.rates,
        )

    def journal(self) -> bytes:
        """The reports that this step merged. They must be on disk before its frames acknowledge them."""
        return b"".join(self._journal)

    def restore(self, journal: bytes) -> int:
        """Merge the journal of earlier incarnations, before the first step.

        Returns:
            Length of the whole records. What follows was never acknowledged, and must be cut off the file.
        """
        whole = 0
        while (start := whole + _RECORD.size) <= len(journal):
            tick, length = _RECORD.unpack_from(journal, whole)
            if start + length > len(journal):
                break
            whole = start + length
            try:
                self._merge(tick, ScanReport.decode(journal[start:whole]))
            except WireError:
                self.bad_frames += 1  # damaged on the disk
        self._journal.clear()
        self._turned = np.flatnonzero(self.merger.cells >= 0)
        return whole

    def final(self) -> dict[str, Any]:
        """Counts at the end of the run, in JSON types."""
        names, times = self.search.names, self.search.search_time_s
        everything = [t for t in times if t is not None]
        measures = self.search.measures(self.merger.cells)
        measures["left"]["frontiers"] = len(self.exhaustion.reachable(self.merger.cells)[0])
        merged_ticks: dict[str, list[tuple[int, int]]] = {}
        for (robot, incarnation, number), tick in sorted(self._merged_tick.items()):
            merged_ticks.setdefault(f"{robot}/{incarnation}", []).append((number, tick))
        return (
            {
                "search_rate": dict(zip(names, self.search.rates, strict=True)),
                "search_time_s": dict(zip(names, times, strict=True))
                | {"all": max(everything) if everything and len(everything) == len(times) else None},
                "victims_found": sorted(self.merger.victims),
                "bad_frames": self.bad_frames + self.router.bad_frames,
                "merged_ticks": merged_ticks,
            }
            | measures
            | self.merger.tally()
        )
