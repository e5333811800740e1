"""Valid messages of every kind: those of a short run with restarts, pauses, victims and a station that comes back."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgpack

from agents.messages import AHEAD, UPDATE, Update, kind_of
from bus.envelopes import Answer, Flood, Moves, Opening, Refused, Turn
from bus.heartbeat import Beat
from bus.lockstep import Kind, seal
from bus.phases import Phases
from deploy.scenario import Scenario, load
from deploy.simulation import Observer, Simulation
from medium.core import Medium
from medium.messages import Inbox, Transmission
from world.core import Begin, World
from world.feed import Absence, Signal, pack_feed
from world.messages import Departed, Motion, Positions, Report, Stop

TICKS = 90


@functools.cache
def scenario(policy: str = "vds") -> Scenario:
    """Four robots, with victims beside the station."""
    faults = ["restart:2@2+1", "pause:3@3+0.5", "restart:station@4+1", "jam:0,1@6+1", "loss:0.1@7+1"]
    asked = {"robots": 4, "radius_m": 12.0, "policy": policy, "fault": faults}
    asked["victims.positions_m"] = [[28.0, 36.0], [29.0, 35.0]]
    return load("three_cells", asked | {"radio.model": "disk_los", "lidar.beams": 60})


@dataclass
class Recorded:
    """Messages of a run, packed, by their kind; and its last counts."""

    packed: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    finals: dict[str, dict[str, Any]] = field(default_factory=dict)


class RecordingWorld(World):
    """Keeps what it hands out and takes in."""

    kept: Recorded

    def begin(self) -> Begin:
        begin, packed = super().begin(), self.kept.packed
        senses = [(node, seal(Kind.DATA, node + 1, sense.encode())) for node, sense in begin.senses.items()]
        packed["sense"] += [sense.encode() for sense in begin.senses.values()]
        packed["positions"].append(begin.positions.encode())
        packed["opening"].append(Opening(packed["positions"][-1], senses).encode())
        packed["turn"] += [Turn(sense, b"inbox").encode() for _, sense in senses]
        packed["signal"] += [signal.encode() for signal in begin.signals]
        return begin

    def end(self, motions: Mapping[int, Motion], report: Report | None) -> Stop | None:
        packed = self.kept.packed
        packed["motion"] += [motion.encode() for motion in motions.values()]
        answers = [(node, node + 1, self.tick, motion.encode()) for node, motion in motions.items()]
        packed["moves"].append(Moves(answers, self.tick, [(1, 7)]).encode())
        if report is not None:
            packed["report"].append(report.encode())
        return super().end(motions, report)


class RecordingMedium(Medium):
    """Keeps what it takes in and hands out."""

    kept: Recorded

    def step(self, positions: Positions, transmissions: Mapping[int, Transmission]) -> dict[int, Inbox]:
        packed = self.kept.packed
        for transmission in transmissions.values():
            packed["transmission"].append(transmission.encode())
            packed["answer"].append(Answer(positions.tick, packed["transmission"][-1], b"motion").encode())
            for _, payload in transmission.frames:
                packed[f"payload {kind_of(payload)}"].append(payload)
            if transmission.src == 2 and transmission.frames:
                packed["rows"].append(Update.decode(transmission.frames[0][1]).rows)
        inboxes = super().step(positions, transmissions)
        packed["inbox"] += [inbox.encode() for inbox in inboxes.values()]
        return inboxes


@functools.cache
def recorded() -> Recorded:
    """What the run left; made once."""
    kept, snapshots = Recorded(), []
    observer = Observer(
        snapshot=snapshots.append,
        event=lambda event: kept.packed["event"].append(event.encode()),
        table=lambda table: kept.packed["table"].append(table.encode()),
    )
    simulation = Simulation(scenario(), observer)
    simulation.world, simulation.medium = (
        RecordingWorld(scenario().world_config()),
        RecordingMedium(scenario().medium_config()),
    )
    simulation.world.kept = simulation.medium.kept = kept
    for _ in range(TICKS):
        simulation.step()
    assert simulation.station is not None
    kept.packed["snapshot"] = [snapshot.encode() for snapshot in snapshots]
    kept.packed["feed"] = [pack_feed(snapshots[start : start + 10]) for start in range(0, TICKS, 10)]
    kept.packed["batch"] = kept.packed["feed"]
    kept.packed["departed"] = [Departed(7, 3).encode()]
    kept.packed["flood"] = [Flood(3).encode()]
    kept.packed["refused"] = [Refused("another living process is already robot 3").encode()]
    kept.packed["beat"] = [Beat(7, 0.25).encode(), Beat(2**32 - 1, 59.5).encode()]
    kept.packed["absence"] = [Absence(3, dead).encode() for dead in (False, True)]
    kept.packed["stop"] = [Stop(90, "searched").encode()]
    kept.packed["signal"].append(Signal(7, 3, "cont").encode())
    kept.packed["sealed"] = [seal(kind, 7, b"body") for kind in Kind]
    updates = [Update.decode(payload) for payload in kept.packed[f"payload {UPDATE}"]]
    kept.packed["acks"] = [update.acks for update in updates if update.acks]
    kept.packed["ahead"] = [AHEAD.pack(1, 0, 1, 0b1011), AHEAD.pack(1, 0, 3, 1 << 15) + AHEAD.pack(2, 1, 0, 1)]
    kept.packed["journal"] = [bytes(simulation._journal)]
    phases = Phases(lambda: 1.0)
    phases.mark("waiting")
    kept.packed["phases"] = [phases.encode()]
    kept.finals = {
        "world": simulation.world.final(), "medium": simulation.medium.final(), "station": simulation.station.final(),
    }  # fmt: skip
    kept.packed["final"] = [msgpack.packb(final) for final in kept.finals.values()]
    return kept
