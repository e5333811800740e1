"""What the radio carries. The medium sees source, link-layer destination and size; it never reads a payload."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Final, NamedTuple

from bus.codec import WireError, integer, pack, unpack
from world.messages import MAX_NODE, MAX_TICK

BROADCAST: Final = -1
"""Link-layer destination of a frame that every node in range receives."""

MAX_FRAME_BYTES: Final = 1 << 20


class Frame(NamedTuple):
    """One radio frame as its sender hands it over."""

    dst: int
    """Link-layer destination: a neighbor's id or BROADCAST."""
    payload: bytes


@dataclass(frozen=True, slots=True)
class Transmission:
    """All frames of one node in one tick, in order; sent every tick, even if empty."""

    tick: int
    src: int
    frames: tuple[Frame, ...]

    def encode(self) -> bytes:
        return pack((self.tick, self.src, [(f.dst, f.payload) for f in self.frames]))

    @classmethod
    def decode(cls, data: bytes) -> Transmission:
        tick, src, raw = unpack(data, 3)
        if not isinstance(raw, list):
            raise WireError("frames are not a list")
        frames = []
        for item in raw:
            if not isinstance(item, list) or len(item) != 2 or not isinstance(item[1], bytes):
                raise WireError("a frame is (dst, payload)")
            if len(item[1]) > MAX_FRAME_BYTES:
                raise WireError("a frame is too long")
            frames.append(Frame(integer(item[0], BROADCAST, MAX_NODE), item[1]))
        return cls(integer(tick, 0, MAX_TICK), integer(src, 0, MAX_NODE), tuple(frames))


class Reception(NamedTuple):
    """One frame as a receiver hears it."""

    src: int
    rx_power_dbm: float
    payload: bytes


# An inbox is decoded by every node at every tick, so its parts are made without a Python call for each.
_reception = partial(tuple.__new__, Reception)


@dataclass(frozen=True, slots=True)
class Inbox:
    """Every frame that a node hears at `tick`: those sent at `tick` - 1, ordered by source, then as sent."""

    tick: int
    receptions: tuple[Reception, ...]

    def encode(self) -> bytes:
        sources, powers, payloads = zip(*self.receptions, strict=True) if self.receptions else ((), (), ())
        return pack((self.tick, sources, struct.pack(f"<{len(powers)}d", *powers), payloads))

    @classmethod
    def decode(cls, data: bytes) -> Inbox:
        tick, sources, raw, payloads = unpack(data, 4)
        if not isinstance(sources, list) or not isinstance(payloads, list) or len(sources) != len(payloads):
            raise WireError("sources and payloads are lists of one length")
        if type(raw) is not bytes or len(raw) != 8 * len(sources):
            raise WireError("powers are a column as long as sources")
        powers = struct.unpack(f"<{len(sources)}d", raw)
        if not all(map(isfinite, powers)) or not all([type(p) is bytes for p in payloads]):  # noqa: C419  # a list is faster
            raise WireError("a power is not finite, or a payload not bytes")
        if not all([type(s) is int and 0 <= s <= MAX_NODE for s in sources]):  # noqa: C419
            raise WireError("a source is not a node")
        heard = map(_reception, zip(sources, powers, payloads, strict=True))
        return cls(integer(tick, 0, MAX_TICK), tuple(heard))
