"""What the radio carries. The medium sees source, link-layer destination and size; it never reads a payload."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isfinite
from typing import Final, TypeAlias

from bus.codec import WireError, integer, pack, unpack
from world.messages import MAX_NODE, MAX_TICK

BROADCAST: Final = -1
"""Link-layer destination of a frame that every node in range receives."""

MAX_FRAME_BYTES: Final = 1 << 20


Frame: TypeAlias = tuple[int, bytes]
"""One radio frame as its sender hands it over: its link-layer destination (a neighbor's id, or BROADCAST), payload."""

Reception: TypeAlias = tuple[int, float, bytes]
"""One frame as a receiver hears it: its source, the received power in dBm, payload."""


@dataclass(slots=True, init=False)
class Transmission:
    """All frames of one node in one tick, in order; sent every tick, even if empty."""

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
            if len(item[1]) > MAX_FRAME_BYTES:
                raise WireError("a frame is too long")
            frames.append((integer(item[0], BROADCAST, MAX_NODE), item[1]))
        return Transmission(integer(tick, 0, MAX_TICK), integer(src, 0, MAX_NODE), tuple(frames))


@dataclass(slots=True, init=False)
class Inbox:
    """Every frame that a node hears at `tick`: those sent at `tick` - 1, ordered by source, then as sent."""

    tick: int
    receptions: tuple[Reception, ...]

    def __init__(self, tick: int, receptions: tuple[Reception, ...]) -> None:
        self.tick = tick
        self.receptions = receptions

    def encode(self) -> bytes:
        sources, powers, payloads = zip(*self.receptions, strict=True) if self.receptions else ((), (), ())
        n = len(payloads)
        return pack((self.tick, struct.pack(f"<{n}H", *sources), struct.pack(f"<{n}d", *powers), payloads))

    @staticmethod
    def decode(data: bytes) -> Inbox:
        tick, ids, levels, payloads = unpack(data, 4)
        if not isinstance(payloads, list):
            raise WireError("payloads are a list")
        n = len(payloads)
        if type(ids) is not bytes or len(ids) != 2 * n or type(levels) is not bytes or len(levels) != 8 * n:
            raise WireError("sources and powers are columns as long as payloads")
        sources, powers = struct.unpack(f"<{n}H", ids), struct.unpack(f"<{n}d", levels)
        if max(sources, default=0) > MAX_NODE:
            raise WireError("a source is not a node")
        if not all(map(isfinite, powers)) or not all([type(p) is bytes for p in payloads]):  # noqa: C419  # a list is faster
            raise WireError("a power is not finite, or a payload not bytes")
        return Inbox(integer(tick, 0, MAX_TICK), tuple(zip(sources, powers, payloads, strict=True)))
