"""Messages to those who watch a run: recorder, launcher and studies, never a robot.

The world's feed (key `feed`) is a batch of snapshots; an event and a signal come one by one (keys `event`, `signal`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bus.codec import WireError, boolean, column, integer, of_json_types, pack, places, share, text, unpack, within
from bus.lockstep import batch, unbatch
from world.terms import MAX_NODE, MAX_TICK, NOBODY, Cls, Mode

SIGNALS: Final = ("kill", "stop", "cont", "spawn", "look")

_F8: Final = np.dtype("<f8")
_I2: Final = np.dtype("<i2")
_U1: Final = np.dtype("u1")


def pack_feed(snapshots: Sequence[Snapshot]) -> bytes:
    """One message of the feed."""
    return batch([snapshot.encode() for snapshot in snapshots])


def unpack_feed(data: bytes) -> list[Snapshot]:
    """The snapshots of one message of the feed.

    Raises:
        WireError: it is no batch, or something in it is no snapshot.
    """
    return [Snapshot.decode(packed) for packed in unbatch(data)]


@dataclass(slots=True, init=False)
class Snapshot:
    """All that the world knows at the end of a tick.

    Columns follow `nodes` (ascending; every robot of the scenario, dead ones too, without the station).
    """

    tick: int
    nodes: NDArray[np.int16]
    present: NDArray[np.uint8]
    """1 = takes part; 0 = departed (dead, paused or unresponsive)."""
    xy_m: NDArray[np.float64]
    """(n, 2) true positions at the start of the tick."""
    cls: NDArray[np.uint8]
    mode: NDArray[np.uint8]
    hops: NDArray[np.uint8]
    nms: NDArray[np.int16]
    msr: NDArray[np.int16]
    target_m: NDArray[np.float64]
    """(n, 2)"""
    reports_buffered: int
    search_rate: tuple[float, ...]
    merged: int
    victims_found: tuple[int, ...]

    def __init__(
        self,
        tick: int,
        nodes: NDArray[np.int16],
        present: NDArray[np.uint8],
        xy_m: NDArray[np.float64],
        cls: NDArray[np.uint8],
        mode: NDArray[np.uint8],
        hops: NDArray[np.uint8],
        nms: NDArray[np.int16],
        msr: NDArray[np.int16],
        target_m: NDArray[np.float64],
        reports_buffered: int = 0,
        search_rate: tuple[float, ...] = (),
        merged: int = 0,
        victims_found: tuple[int, ...] = (),
    ) -> None:
        self.tick = tick
        self.nodes = nodes
        self.present = present
        self.xy_m = xy_m
        self.cls = cls
        self.mode = mode
        self.hops = hops
        self.nms = nms
        self.msr = msr
        self.target_m = target_m
        self.reports_buffered = reports_buffered
        self.search_rate = search_rate
        self.merged = merged
        self.victims_found = victims_found

    def encode(self) -> bytes:
        return pack((
            self.tick, self.nodes.astype(_I2).tobytes(), self.present.astype(_U1).tobytes(),
            self.xy_m.astype(_F8).tobytes(), self.cls.astype(_U1).tobytes(), self.mode.astype(_U1).tobytes(),
            self.hops.astype(_U1).tobytes(), self.nms.astype(_I2).tobytes(), self.msr.astype(_I2).tobytes(),
            self.target_m.astype(_F8).tobytes(), self.reports_buffered, self.search_rate, self.merged,
            self.victims_found,
        ))  # fmt: skip

    @staticmethod
    def decode(data: bytes) -> Snapshot:
        f = unpack(data, 14)
        nodes = column(f[1], _I2)
        n = len(nodes)
        if not isinstance(f[11], list) or not isinstance(f[13], list):
            raise WireError("search rates and victims are lists")
        if not np.array_equal(nodes, np.arange(1, n + 1)):
            raise WireError("a snapshot has robots 1 to N")
        return Snapshot(
            integer(f[0], 0, MAX_TICK), nodes, within(column(f[2], _U1, n), 0, 1), places(f[3], _F8, n),
            within(column(f[4], _U1, n), 0, max(Cls)), within(column(f[5], _U1, n), 0, max(Mode)),
            column(f[6], _U1, n), within(column(f[7], _I2, n), NOBODY, n), within(column(f[8], _I2, n), NOBODY, n),
            places(f[9], _F8, n), integer(f[10], 0, MAX_TICK), tuple(share(r) for r in f[11]),
            integer(f[12], 0, MAX_TICK), tuple(integer(v, 0, MAX_NODE) for v in f[13]),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run: a line in events.jsonl and in the recording's log."""

    tick: int
    kind: str
    """fault | recovery | role | link | victim | mission | drop"""
    node: int
    text: str
    data: dict[str, Any] = field(default_factory=dict)
    """Further facts, JSON types only."""

    def encode(self) -> bytes:
        return pack((self.tick, self.kind, self.node, self.text, self.data))

    @classmethod
    def decode(cls, data: bytes) -> Event:
        tick, kind, node, words, more = unpack(data, 5)
        if not isinstance(more, dict):
            raise WireError("event data is not a map")
        return cls(
            integer(tick, 0, MAX_TICK), text(kind), integer(node, NOBODY, MAX_NODE), text(words), of_json_types(more)
        )


@dataclass(frozen=True, slots=True)
class Signal:
    """What the launcher does to the process of `node` now, by a fault of the scenario or by hand."""

    tick: int
    node: int
    verb: str
    """kill | stop | cont | spawn | look. `spawn` starts a new process at once, so that it is ready when it is due.
    `look` asks how the process stands that the world waits for: if it is dead or stopped, the answer is an `Absence`.
    """

    def encode(self) -> bytes:
        return pack((self.tick, self.node, self.verb))

    @classmethod
    def decode(cls, data: bytes) -> Signal:
        tick, node, verb = unpack(data, 3)
        if verb not in SIGNALS:
            raise WireError(f"not one of {', '.join(SIGNALS)}")
        return cls(integer(tick, 0, MAX_TICK), integer(node, 0, MAX_NODE), text(verb))


@dataclass(frozen=True, slots=True)
class Absence:
    """Launcher -> world: the process of `node` that the world waits for does not come."""

    node: int
    dead: bool
    """Otherwise it is stopped."""

    def encode(self) -> bytes:
        return pack((self.node, self.dead))

    @classmethod
    def decode(cls, data: bytes) -> Absence:
        node, dead = unpack(data, 2)
        return cls(integer(node, 0, MAX_NODE), boolean(dead))
