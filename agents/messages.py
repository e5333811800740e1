"""Payloads of the frames that robots send one another, and the forwarding table that they show to the recorder.

Each payload is one msgpack list whose first field is its kind.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from agents import _rows
from bus.codec import WireError, column, integer, pack, places, unpack, unpacked, within
from world.messages import sightings
from world.terms import MAX_NODE, MAX_TICK, NOBODY, Cls

ACK: Final = struct.Struct("<HHI")
"""Robot, incarnation, number: the MS has all scan reports of that incarnation up to that number."""

AHEAD: Final = struct.Struct("<HHIQ")
"""Robot, incarnation, number, mask: bit b says that the MS has report number + 2 + b, though it lacks number + 1.
It goes with the ACK of that number, where bandwidth is limited (selective acknowledgement: RFC 2018)."""

AHEAD_NUMBERS: Final = 64
"""Numbers that a mask covers."""

_U4: Final = np.dtype("<u4")
_I1: Final = np.dtype("i1")
_F4: Final = np.dtype("<f4")
_I2: Final = np.dtype("<i2")
_U1: Final = np.dtype("u1")

MOST_HOPS: Final = 64
"""Most hops that a scan report may take, since the tree moves while the report travels."""

UPDATE: Final = 1
SCAN_REPORT: Final = 2
MAP_CHUNK: Final = 3


def kind_of(payload: bytes) -> int:
    """Kind of a payload, without decoding it: msgpack begins with a fixarray header and a positive fixint."""
    if len(payload) < 2 or payload[0] & 0xF0 != 0x90:
        raise WireError("not a payload")
    return payload[1]


@dataclass(slots=True, init=False)
class Update:
    """A routing update, broadcast every tick: the whole forwarding table, and what is for neighbors only."""

    nms: int
    """For neighbors only, who learn their inv from it [paper 2.3]."""
    hold: int
    """For neighbors only: the robot that the sender asks to yield (rule C of docs/scout.md), or NOBODY."""
    map_version: int
    """For neighbors only: number of the MS's map changes that the sender holds."""
    rows: bytes
    """A sequence of agents.forwarding_table.ROW; `ForwardingTable.merge` checks it."""
    acks: bytes
    """A sequence of ACK that belongs to the MS's entry; empty: nothing is said of them."""
    acks_version: int
    """Number of the map changes that the MS had made with these reports: the map contains them from then on."""
    ahead: bytes
    """A sequence of AHEAD that goes with `acks`."""

    def __init__(
        self, nms: int, hold: int, map_version: int, rows: bytes, acks: bytes, acks_version: int = 0, ahead: bytes = b""
    ) -> None:
        self.nms = nms
        self.hold = hold
        self.map_version = map_version
        self.rows = rows
        self.acks = acks
        self.acks_version = acks_version
        self.ahead = ahead

    def encode(self) -> bytes:
        fields = UPDATE, self.nms, self.hold, self.map_version, self.rows, self.acks, self.acks_version
        return pack((*fields, self.ahead) if self.ahead else fields)

    @staticmethod
    def decode(data: bytes, robots: int = MAX_NODE, tick: int = MAX_TICK) -> Update:
        """Everything is checked but the rows, which are checked where they are merged.

        Args:
            data: as encoded.
            robots: N, the highest node that can be named.
            tick: in which it is heard.

        Raises:
            WireError: it is no update, or one with a node or a number that can't be (agents/limits.py).
        """
        fields = unpacked(data)
        if not _rows.update_possible(fields, robots, MAX_TICK, tick):
            raise WireError("no update, or one with a node, a number or acknowledgements that can't be")
        _, nms, hold, version, rows, acks, acks_version, *ahead = fields
        return Update(nms, hold, version, rows, acks, acks_version, *ahead)


@dataclass(slots=True, init=False)
class ScanReport:
    """What one lidar scan is evidence for (agents/evidence.py), or a part of that. It travels hop by hop to the MS."""

    HEAD_BYTES: ClassVar[int] = 40
    """Most that an encoded report takes beside its cells and victims."""
    CELL_BYTES: ClassVar[int] = 5
    VICTIM_BYTES: ClassVar[int] = 28
    """Most that a victim takes."""

    origin: int
    incarnation: int
    number: int
    """Counts from 1 within the incarnation."""
    cells: NDArray[np.uint32]
    values: NDArray[np.int8]
    """FREE for a cell that was missed, OCCUPIED for one that was hit."""
    victims: tuple[tuple[int, float, float], ...]

    def __init__(
        self,
        origin: int,
        incarnation: int,
        number: int,
        cells: NDArray[np.uint32],
        values: NDArray[np.int8],
        victims: tuple[tuple[int, float, float], ...] = (),
    ) -> None:
        self.origin = origin
        self.incarnation = incarnation
        self.number = number
        self.cells = cells
        self.values = values
        self.victims = victims

    def encode(self) -> bytes:
        body = pack((
            self.origin, self.incarnation, self.number,
            self.cells.astype(_U4, copy=False).tobytes(), self.values.astype(_I1, copy=False).tobytes(), self.victims,
        ))  # fmt: skip
        return pack((SCAN_REPORT, MOST_HOPS, body))

    @staticmethod
    def decode(data: bytes) -> ScanReport:
        _, hops_left, body = unpack(data, 3)
        integer(hops_left, 0, MOST_HOPS)
        origin, incarnation, number, cells, values, victims = unpack(body, 6)
        indices = column(cells, _U4)
        return ScanReport(
            integer(origin, 0, MAX_NODE), integer(incarnation, 0, MAX_NODE), integer(number, 1, MAX_TICK),
            indices, _votes(values, len(indices)), sightings(victims),
        )  # fmt: skip


def one_hop_on(report: bytes) -> bytes | None:
    """The payload with which a relay passes on an encoded scan report, unread; None if it has taken too many hops.

    Raises:
        WireError: not a scan report.
    """
    _, hops_left, body = unpack(report, 3)
    integer(hops_left, 0, MOST_HOPS)
    if not isinstance(body, bytes):
        raise WireError("a scan report has a body")
    return pack((SCAN_REPORT, hops_left - 1, body)) if hops_left else None


def body_of(onward: bytes) -> bytes:
    """What `one_hop_on` passes on: the same for all copies of a report, however many hops they have left."""
    return onward[3:]


def _votes(raw: object, length: int) -> NDArray[np.int8]:
    values = column(raw, _I1, length)
    assert isinstance(raw, bytes), "or else it is no column"
    if raw.translate(None, b"\0\1"):
        raise WireError("a cell is neither missed nor hit")
    return values


@dataclass(slots=True, init=False)
class MapChunk:
    """The MS's map changes number `first` to `first` + n - 1, on their way down."""

    HEAD_BYTES: ClassVar[int] = 20
    """Most that an encoded chunk takes beside its changes."""
    CHANGE_BYTES: ClassVar[int] = 5

    first: int
    cells: NDArray[np.uint32]
    odds: NDArray[np.int8]
    """What a cell's odds are since that change (agents/evidence.py): states, nothing to add."""

    def __init__(self, first: int, cells: NDArray[np.uint32], odds: NDArray[np.int8]) -> None:
        self.first = first
        self.cells = cells
        self.odds = odds

    def encode(self) -> bytes:
        cells = self.cells.astype(_U4, copy=False).tobytes()
        return pack((MAP_CHUNK, self.first, cells, self.odds.astype(_I1, copy=False).tobytes()))

    @staticmethod
    def decode(data: bytes) -> MapChunk:
        _, first, cells, odds = unpack(data, 4)
        indices = column(cells, _U4)
        return MapChunk(integer(first, 0, MAX_TICK), indices, column(odds, _I1, len(indices)))


@dataclass(frozen=True, slots=True)
class Table:
    """A robot's forwarding table with every column of Fig. 2 [paper 2.4]; for the recording only."""

    tick: int
    node: int
    msr: int
    dst: NDArray[np.int16]
    next_hop: NDArray[np.int16]
    """NOBODY where the route is infinite."""
    hop: NDArray[np.uint8]
    xy_m: NDArray[np.float32]
    """(n, 2) location"""
    inv: NDArray[np.uint8]
    """1 where the destination names this robot as its NMS."""
    cls: NDArray[np.uint8]

    def encode(self) -> bytes:
        return pack((
            self.tick, self.node, self.msr, self.dst.astype(_I2).tobytes(), self.next_hop.astype(_I2).tobytes(),
            self.hop.astype(_U1).tobytes(), self.xy_m.astype(_F4).tobytes(), self.inv.astype(_U1).tobytes(),
            self.cls.astype(_U1).tobytes(),
        ))  # fmt: skip

    @classmethod
    def decode(cls, data: bytes) -> Table:
        tick, node, msr, dst, next_hop, hop, xy, inv, classes = unpack(data, 9)
        ids = column(dst, _I2)
        n = len(ids)
        if (ids[1:] <= ids[:-1]).any():
            raise WireError("destinations are not ascending")
        return cls(
            integer(tick, 0, MAX_TICK), integer(node, 0, MAX_NODE), integer(msr, NOBODY, MAX_NODE),
            within(ids, 0, MAX_NODE), within(column(next_hop, _I2, n), NOBODY, MAX_NODE), column(hop, _U1, n),
            places(xy, _F4, n), within(column(inv, _U1, n), 0, 1), within(column(classes, _U1, n), 0, max(Cls)),
        )  # fmt: skip
