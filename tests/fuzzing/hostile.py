"""A run of the real cores in which any message may be another one by the time it arrives."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import Final, TypeVar

from agents.policies import policy_class
from agents.robot import Robot
from bus.codec import WireError
from bus.envelopes import Answer
from medium.answers import transmission_of
from medium.core import Medium
from medium.messages import Frame, Inbox, Reception, Transmission
from monitor_station.core import Station
from tests.fuzzing.mutations import mutated
from tests.fuzzing.samples import recorded, scenario
from tests.oracles.forwarding_table import check_invariants
from world.core import Begin, World
from world.limits import decode_word
from world.messages import Motion, Positions, Report, Sense
from world.seeds import node_stream
from world.terms import STATION

MOST_STEP_S: Final = 2.0
"""Processor time of one step of one core."""
MOST_FRAMES_BYTES: Final = 4_000_000
"""What one node may send in a tick, whatever it has heard."""
_GIVEN_UP: Final = 0.3
"""Chance that a node which did not answer is given up for good: else it is back in the next tick."""

M = TypeVar("M")
R = TypeVar("R")


class HostileRun:
    """Four robots and a station; the world and the medium lie, too."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._scenario = scenario(rng.choice(("vds", "scout")))
        self._share = rng.choice((0.02, 0.2, 0.7))
        """Of the messages that are changed on their way."""
        self._world = World(self._scenario.world_config())
        self._radio = self._scenario.medium_config()
        self._medium = Medium(self._radio)
        self._robots: dict[int, Robot] = {}
        self._station: Station | None = None
        self._inboxes: dict[int, Inbox] = {}
        self._pool = [packed for kind in recorded().packed.values() for packed in kind[:50]]
        self.inputs = 0
        """Messages that were changed."""
        self.refused = 0

    def tick(self) -> bool:
        """One tick; False if the run is over."""
        world = self._world
        for node in sorted(world.awaited()):
            world.arrive(node, new=True)
        begin = world.begin()
        transmissions, motions, report = self._nodes(begin)
        positions = self._passed(begin.positions.encode(), Positions.decode, begin.positions)
        # The medium gathers the frames of the roster that it is told.
        heard = {node: transmissions[node] for node in positions.nodes.tolist() if node in transmissions}
        self._inboxes = self._within_time(lambda: self._medium.step(positions, heard))
        for node in begin.senses:
            if node != STATION and node not in motions:
                world.depart(node, "unresponsive", counted=False)
        stop = self._within_time(lambda: world.end(motions, report))
        world.tell().snapshot.encode()
        for node in begin.senses:
            if node != STATION and node not in motions and self._rng.random() > _GIVEN_UP:
                world.arrive(node, new=False)
        return stop is None

    def _nodes(self, begin: Begin) -> tuple[dict[int, Transmission], dict[int, Motion], Report | None]:
        tick = begin.tick
        transmissions: dict[int, Transmission] = {}
        motions: dict[int, Motion] = {}
        report = None
        for node, sense in begin.senses.items():
            frames, word = self._step(node, sense)
            packed = Answer(
                tick, self._altered(Transmission(tick, node, frames).encode()), self._altered(word.encode())
            )
            try:
                transmissions[node] = transmission_of(node, packed, self._radio)
            except WireError:
                self.refused += 1
                continue
            said = decode_word(node, tick, packed.motion, robots=self._radio.robots, cells=self._radio.cells)
            if isinstance(said, Report):
                report = said
            else:
                motions[node] = said
        return transmissions, motions, report

    def _step(self, node: int, sense: Sense) -> tuple[tuple[Frame, ...], Motion | Report]:
        config = self._scenario.robot_config(node)
        core = self._core(node, sense)
        sense = self._passed(sense.encode(), lambda data: Sense.decode(data, config.lidar_beams), sense)
        inbox = None
        if not sense.first:
            heard = self._inboxes.get(node, Inbox(sense.tick, ())).receptions
            inbox = Inbox(sense.tick, tuple(map(self._reception, heard)))
            inbox = self._passed(inbox.encode(), lambda data: Inbox.decode(data, config.robots), inbox)
        frames, answer = self._within_time(lambda: core.step(sense, inbox))
        router = core.router if isinstance(core, Station) else core.body.router
        check_invariants(router.table)
        assert max(router.table.known) <= config.robots, "a robot that there is not"
        assert sum(len(payload) for _, payload in frames) < MOST_FRAMES_BYTES, "frames without bound"
        if isinstance(core, Station):
            core.view()
        else:
            core.table()
        return frames, answer

    def _core(self, node: int, sense: Sense) -> Robot | Station:
        rng = node_stream(1, node, sense.incarnation)
        if node == STATION:
            if self._station is None or (sense.first and self._rng.random() < 0.5):
                self._station = Station(self._scenario.station_config(), rng, sense.incarnation, sense.tick)
            return self._station
        if node not in self._robots or (sense.first and self._rng.random() < 0.5):
            config = self._scenario.robot_config(node)
            self._robots[node] = Robot(config, policy_class(config.policy), rng, sense.incarnation, sense.tick)
        return self._robots[node]

    def _reception(self, reception: Reception) -> Reception:
        src, power_dbm, payload = reception
        return src, power_dbm, self._passed(payload, lambda data: data, payload)

    def _altered(self, packed: bytes) -> bytes:
        """What arrives of a message."""
        if self._rng.random() < self._share:
            self.inputs += 1
            packed = mutated(self._rng, packed, self._pool)
        return packed

    def _passed(self, packed: bytes, decode: Callable[[bytes], M], instead: M) -> M:
        """What is read of a message that arrives; `instead` if it is refused, as an honest word may be after a lie."""
        try:
            return decode(self._altered(packed))
        except WireError:
            self.refused += 1
            return instead

    @staticmethod
    def _within_time(step: Callable[[], R]) -> R:
        since_s = time.process_time()
        result = step()
        took_s = time.process_time() - since_s
        assert took_s < MOST_STEP_S, f"a step of {took_s:.1f} s"
        return result
