"""What the radio carries. The medium sees source, link-layer destination and size; it never reads a payload."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from bus.codec import WireError, column, integer, pack, unpack
from world.messages import MAX_NODE, MAX_TICK

BROADCAST: Final = -1
"""Link-layer destination of a frame that every node in range receives."""

MAX_FRAME_BYTES: Final = 1 << 20
_F8: Final = np.dtype("<f8")


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


@dataclass(frozen=True, slots=True)
class Inbox:
    """Every frame that a node hears at `tick`: those sent at `tick` - 1, ordered by source, then as sent."""

    tick: int
    receptions: tuple[Reception, ...]

    def encode(self) -> bytes:
        heard = self.receptions
        powers = np.array([r.rx_power_dbm for r in heard], _F8).tobytes()
        return pack((self.tick, [r.src for r in heard], powers, [r.payload for r in heard]))

    @classmethod
    def decode(cls, data: bytes) -> Inbox:
        tick, sources, raw, payloads = unpack(data, 4)
        if not isinstance(sources, list) or not isinstance(payloads, list) or len(sources) != len(payloads):
            raise WireError("sources and payloads are lists of one length")
        powers = column(raw, _F8, len(sources))
        if not np.isfinite(powers).all() or not all(isinstance(p, bytes) for p in payloads):
            raise WireError("a power is not finite, or a payload not bytes")
        heard = zip(sources, powers.tolist(), payloads, strict=True)
        return cls(integer(tick, 0, MAX_TICK), tuple(Reception(integer(s, 0, MAX_NODE), p, b) for s, p, b in heard))
