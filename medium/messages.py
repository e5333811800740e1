"""What the radio carries. The medium sees source, link-layer destination and size; it never reads a payload."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, TypeAlias

from bus.codec import WireError, head, integer, pack, unpack
from medium import _receptions
from world.terms import MAX_NODE, MAX_TICK

BROADCAST: Final = -1
"""Link-layer destination of a frame that every node in range receives."""

UNLIMITED: Final = 2**32 - 1
"""Bytes that a node may send where there is no limit."""

_HEAD: Final = struct.Struct("<III")
"""Head of an inbox: tick, room and share."""


Frame: TypeAlias = tuple[int, bytes]
"""A radio frame as its sender hands it over: link-layer destination (a neighbor's id or BROADCAST) and payload."""

Reception: TypeAlias = tuple[int, float, bytes]
"""A frame as a receiver hears it: source, received power in dBm, payload."""


@dataclass(slots=True, init=False)
class Transmission:
    """All frames of one node in one tick, in order. A node sends one every tick, even an empty one."""

    tick: int
    src: int
    frames: tuple[Frame, ...]

    def __init__(self, tick: int, src: int, frames: tuple[Frame, ...]) -> None:
        self.tick = tick
        self.src = src
        self.frames = frames

    def encode(self) -> bytes:
        return pack((self.tick, self.src, self.frames))

    @staticmethod
    def decode(data: bytes) -> Transmission:
        tick, src, raw = unpack(data, 3)
        if not isinstance(raw, list):
            raise WireError("frames are not a list")
        frames: list[Frame] = []
        for item in raw:
            if not isinstance(item, list) or len(item) != 2 or not isinstance(item[1], bytes):
                raise WireError("a frame is (dst, payload)")
            frames.append((integer(item[0], BROADCAST, MAX_NODE), item[1]))
        return Transmission(integer(tick, 0, MAX_TICK), integer(src, 0, MAX_NODE), tuple(frames))


@dataclass(slots=True, init=False)
class Inbox:
    """Every frame that a node hears at `tick`, sent at `tick` - 1; ordered by source, then as sent."""

    tick: int
    receptions: tuple[Reception, ...]
    room_bytes: int
    """What the node's radio takes in this tick."""
    share_bytes: int
    """What each tick adds to that; the radio keeps what the node leaves unsent, for a while (medium/airtime.py)."""

    def __init__(
        self,
        tick: int,
        receptions: tuple[Reception, ...],
        room_bytes: int = UNLIMITED,
        share_bytes: int = UNLIMITED,
    ) -> None:
        self.tick = tick
        self.receptions = receptions
        self.room_bytes = room_bytes
        self.share_bytes = share_bytes

    def encode(self) -> bytes:
        return _HEAD.pack(self.tick, self.room_bytes, self.share_bytes) + _receptions.pack_receptions(self.receptions)

    @staticmethod
    def decode(data: bytes, robots: int = MAX_NODE) -> Inbox:
        """`robots`: N, the highest node that can be heard."""
        tick, room_bytes, share_bytes = head(_HEAD, data)
        integer(tick, 0, MAX_TICK)
        receptions = _receptions.unpack_receptions(data, _HEAD.size, robots)
        if receptions is None:
            raise WireError("an inbox is a run of (node, finite power, payload)")
        return Inbox(tick, receptions, room_bytes, share_bytes)
