"""The core of one robot: it absorbs what it sensed and heard at a tick, decides, and returns its frames and motion."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np

from agents.announcer import Announcer
from agents.body import Action, Body
from agents.config import RobotConfig
from agents.evidence import SensorModel
from agents.giving_way import GivingWay
from agents.map_downlink import MapCopy
from agents.messages import MAP_CHUNK, SCAN_REPORT, MapChunk, Table
from agents.own_reports import OwnReports
from agents.payloads import sort_payloads
from agents.room import Room
from agents.scan_uplink import ScanUplink
from agents.vds import Vds
from bus.codec import WireError
from bus.phases import Mark, unmarked
from medium.messages import BROADCAST, Frame, Inbox
from world.messages import Motion, Sense, Status
from world.terms import NOBODY, Cls, Mode

_TABLE_INTERVAL_TICKS = 10


class Robot:
    """Sans-IO: no clock, no threads, no Zenoh. One instance is one incarnation."""

    def __init__(
        self, config: RobotConfig, policy: type[Vds], rng: random.Random, incarnation: int, first_tick: int
    ) -> None:
        """A new incarnation sends and learns no routes while its old routes die out [paper 2.10].

        Args:
            config: what it knows before it starts.
            policy: the class that decides (agents/policies.py).
            rng: this incarnation's own generator.
            incarnation: how many came before it.
            first_tick: the first tick in which it takes part.
        """
        quiet_until = config.rules.routing.quiet_until(incarnation, first_tick)
        self.config = config
        self.mark: Mark = unmarked
        """Called at the end of each phase of a step."""
        self.body = Body(config, rng, quiet_until)
        self.policy = policy(self.body)
        self._giving_way = GivingWay(self.body)
        reporting = config.rules.reporting
        self._store_and_forward = reporting.store_and_forward
        self.uplink = ScanUplink(config.node, incarnation, reporting, limited=config.bandwidth_limited)
        self.downlink = MapCopy(reporting.chunk_cells, SensorModel(config))
        self._own_reports = OwnReports()
        self._announcer = Announcer(self.body.router)
        self._handlers: dict[int, Callable[[bytes], None]] = {
            SCAN_REPORT: self.uplink.carry,
            MAP_CHUNK: self._take_map,
        }
        self._victims_seen: set[int] = set()
        self.bad_frames = 0
        self._action = Action((0.0, 0.0), Mode.WAIT, Cls.SR, self.body.at)
        self._shown: object = None
        """The forwarding table that was shown last, without its locations."""

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:
        """One tick.

        Args:
            sense: own pose, and a lidar scan when due.
            inbox: what was heard; None at the first tick after (re)joining.
        """
        tick, body = sense.tick, self.body
        body.tick, body.at = tick, (sense.x_m, sense.y_m)
        mark = self.mark
        updates, bad = sort_payloads(inbox, self._handlers)
        self.bad_frames += bad
        mark("decode")
        body.router.step(tick, updates)
        mark("routing")
        try:
            self.uplink.acknowledge(tick, body.router.ms.acks, body.router.ms.ahead)
        except WireError:
            self.bad_frames += 1
        for numbered in self.uplink.numbered():
            self._own_reports.add(*numbered)
        for report in self._own_reports.contained(
            self.uplink.acknowledged, body.router.ms.acks_version, self.downlink.version
        ):
            body.map.forget(*report)
        if sense.ranges_m is not None:
            self._scan(sense)
        mark("mapping")
        action = self._action = self.policy.step()
        velocity = self._giving_way.velocity(action)
        mark("planning")
        body.router.announce_self(tick, body.at, action.cls, action.target_m, need=action.need)
        room = Room(inbox, limited=self.config.bandwidth_limited)
        return self._frames(tick, action, room), Motion(tick, *velocity, self._status(action))

    def _take_map(self, payload: bytes) -> None:
        chunk = MapChunk.decode(payload)
        self.body.router.limits.check_chunk(chunk)
        cells, odds = self.downlink.receive(chunk)
        if cells.size:
            self.body.map.apply(cells, odds)

    def _scan(self, sense: Sense) -> None:
        """Integrate a scan, and report what it is evidence for."""
        if not self._store_and_forward and self.body.router.ms.nms == NOBODY:
            # A point counts only if the robot has a path to the MS meanwhile [paper 7.2]. The map leaves the scan out
            # too, so that its cells are new again later.
            self.uplink.discarded += 1
            return
        assert sense.ranges_m is not None
        counted, values, discovered = self.body.map.integrate(sense.x_m, sense.y_m, sense.ranges_m)
        cells = counted.astype(np.uint32)
        self.policy.explorer.discovered(discovered)
        victims = tuple(v for v in sense.victims if v[0] not in self._victims_seen)
        self._victims_seen.update(v[0] for v in victims)
        if cells.size or victims:
            self.uplink.make(sense.tick, cells, values, victims)

    def _frames(self, tick: int, action: Action, room: Room) -> tuple[Frame, ...]:
        """What to send, most important first, as far as there is room: routing, acknowledgements, scans, the map."""
        router = self.body.router
        if tick < router.quiet_until:
            return ()
        ms, nms = router.ms, router.ms.nms
        acks = ms.acks, ms.acks_version, ms.ahead
        update = self._announcer.update(tick, nms, action.hold, self.downlink.version, acks, room)
        frames: list[Frame] = [] if update is None else [(BROADCAST, update)]
        if nms != NOBODY:
            frames += [(nms, payload) for payload in self.uplink.due(tick, ms.hops, room)]
        else:
            self.uplink.drop_carried()
        frames += self.downlink.due(tick, router.inv, router.neighbors, room)
        return tuple(frames)

    def _status(self, action: Action) -> Status:
        ms, uplink = self.body.router.ms, self.uplink
        x, y = action.target_m
        return Status(
            action.cls, ms.nms, action.msr, self.policy.nmsr, ms.hops, action.mode, x, y,
            uplink.made, uplink.buffered, uplink.discarded, uplink.newest_scan_tick,
        )  # fmt: skip

    def table(self) -> Table | None:
        """The forwarding table for the recording, once a second at most; None if only locations changed since."""
        tick, router, msr = self.body.tick, self.body.router, self._action.msr
        if (tick + self.config.node) % _TABLE_INTERVAL_TICKS:
            return None
        shape = msr, router.inv, router.table.shape()
        if shape == self._shown:
            return None
        self._shown = shape
        return router.shown(tick, msr)
