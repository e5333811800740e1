"""What travels between the world and the others in a tick.

`bus.codec` says how message classes are written, and why.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bus.codec import (
    WireError,
    all_finite,
    boolean,
    column,
    coordinate,
    finite,
    head,
    integer,
    pack,
    places,
    share,
    text,
    unpack,
)
from world.terms import MAX_NODE, MAX_TICK, NOBODY, UNREACHABLE, Cls, Mode

_SENSE: Final = struct.Struct("<I?HIdd")
"""Tick, first, incarnation, beams, x, y; then a scan, then the victims if there are any."""
_NO_SCAN: Final = 2**32 - 1
_MOTION: Final = struct.Struct("<IddB3hBB2d4I")
"""All fields of a `Motion` and its `Status`, in their order."""

_F8: Final = np.dtype("<f8")
_I2: Final = np.dtype("<i2")


@dataclass(slots=True, init=False)
class Sense:
    """What one node senses at a tick. The station gets one too; its scan is None."""

    tick: int
    first: bool
    """True at the node's first tick after it joined or rejoined: it has no inbox yet."""
    incarnation: int
    """How many processes this node had before this one, as the world counts them."""
    x_m: float
    y_m: float
    ranges_m: NDArray[np.float64] | None
    """(beams,) lidar ranges, beam i at angle 2 pi i / beams; the lidar's range where nothing was hit."""
    victims: tuple[tuple[int, float, float], ...]
    """(victim id, x, y) of victims in sight, only together with a scan."""

    def __init__(
        self,
        tick: int,
        first: bool,
        incarnation: int,
        x_m: float,
        y_m: float,
        ranges_m: NDArray[np.float64] | None = None,
        victims: tuple[tuple[int, float, float], ...] = (),
    ) -> None:
        self.tick = tick
        self.first = first
        self.incarnation = incarnation
        self.x_m = x_m
        self.y_m = y_m
        self.ranges_m = ranges_m
        self.victims = victims

    def encode(self) -> bytes:
        ranges = b"" if self.ranges_m is None else self.ranges_m.astype(_F8, copy=False).tobytes()
        beams = _NO_SCAN if self.ranges_m is None else len(self.ranges_m)
        fixed = _SENSE.pack(self.tick, self.first, self.incarnation, beams, self.x_m, self.y_m)
        return fixed + ranges + pack((self.victims,)) if self.victims else fixed + ranges

    @staticmethod
    def decode(data: bytes, lidar_beams: int | None = None) -> Sense:
        """`lidar_beams`: how many ranges a scan has; None = any number."""
        tick, first, incarnation, beams, x, y = head(_SENSE, data)
        if beams not in (_NO_SCAN, beams if lidar_beams is None else lidar_beams):
            raise WireError("a scan of another lidar")
        end = _SENSE.size if beams == _NO_SCAN else _SENSE.size + 8 * beams
        ranges = None if beams == _NO_SCAN else column(data[_SENSE.size : end], _F8, beams)
        if ranges is not None and not all_finite(ranges):
            raise WireError("a range is not finite")
        victims = sightings(unpack(data[end:], 1)[0]) if len(data) > end else ()
        return Sense(
            integer(tick, 0, MAX_TICK),
            first,
            integer(incarnation, 0, MAX_NODE),
            coordinate(x),
            coordinate(y),
            ranges,
            victims,
        )


def sightings(raw: Any) -> tuple[tuple[int, float, float], ...]:
    """Check a list of (victim id, x, y)."""
    if not isinstance(raw, list):
        raise WireError("victims are not a list")
    out = []
    for item in raw:
        if not isinstance(item, list) or len(item) != 3:
            raise WireError("a victim is not (id, x, y)")
        out.append((integer(item[0], 0, MAX_NODE), coordinate(item[1]), coordinate(item[2])))
    return tuple(out)


@dataclass(slots=True, init=False)
class Status:
    """What a robot says of itself. It serves fault targets, snapshots and verdicts only, never another robot."""

    cls: int
    nms: int
    msr: int
    nmsr: int
    hops: int
    mode: int
    target_x_m: float
    target_y_m: float
    reports_made: int
    reports_buffered: int
    reports_discarded: int
    newest_scan_tick: int
    """Of the scan that the last report made shows."""

    def __init__(
        self,
        cls: int = Cls.SR,
        nms: int = NOBODY,
        msr: int = NOBODY,
        nmsr: int = NOBODY,
        hops: int = UNREACHABLE,
        mode: int = Mode.WAIT,
        target_x_m: float = 0.0,
        target_y_m: float = 0.0,
        reports_made: int = 0,
        reports_buffered: int = 0,
        reports_discarded: int = 0,
        newest_scan_tick: int = 0,
    ) -> None:
        self.cls = cls
        self.nms = nms
        self.msr = msr
        self.nmsr = nmsr
        self.hops = hops
        self.mode = mode
        self.target_x_m = target_x_m
        self.target_y_m = target_y_m
        self.reports_made = reports_made
        self.reports_buffered = reports_buffered
        self.reports_discarded = reports_discarded
        self.newest_scan_tick = newest_scan_tick


@dataclass(slots=True, init=False)
class Motion:
    """What a robot does until the next tick: a velocity, which the world limits to the robot's top speed."""

    tick: int
    vx_m_s: float
    vy_m_s: float
    status: Status

    def __init__(self, tick: int, vx_m_s: float, vy_m_s: float, status: Status) -> None:
        self.tick = tick
        self.vx_m_s = vx_m_s
        self.vy_m_s = vy_m_s
        self.status = status

    def encode(self) -> bytes:
        s = self.status
        return _MOTION.pack(
            self.tick, self.vx_m_s, self.vy_m_s, s.cls, s.nms, s.msr, s.nmsr, s.hops, s.mode,
            s.target_x_m, s.target_y_m, s.reports_made, s.reports_buffered, s.reports_discarded,
            s.newest_scan_tick,
        )  # fmt: skip

    @staticmethod
    def decode(data: bytes) -> Motion:
        if len(data) != _MOTION.size:
            raise WireError(f"a motion has {_MOTION.size} bytes")
        tick, vx, vy, cls, nms, msr, nmsr, hops, mode, x, y, made, buffered, discarded, newest = head(_MOTION, data)
        status = Status(
            integer(cls, 0, 1), integer(nms, NOBODY, MAX_NODE), integer(msr, NOBODY, MAX_NODE),
            integer(nmsr, NOBODY, MAX_NODE), hops, integer(mode, 0, len(Mode) - 1),
            coordinate(x), coordinate(y), integer(made, 0, MAX_TICK),
            integer(buffered, 0, made), integer(discarded, 0, MAX_TICK), integer(newest, 0, MAX_TICK),
        )  # fmt: skip
        return Motion(integer(tick, 0, MAX_TICK), finite(vx), finite(vy), status)


@dataclass(slots=True, init=False)
class Report:
    """What the station says of the mission, at every tick."""

    tick: int
    searched: bool
    search_rate: tuple[float, ...]
    """Share of each search cell's area that is scanned, 0..1, in the scenario's order of cells [paper 7.1]."""
    merged: int
    """Scan reports merged so far, over all incarnations of the station."""
    victims_found: tuple[int, ...]
    silent: bool
    """It sends nothing yet, while its old routes die out [paper 2.10]."""
    exhausted: bool
    """Its map has had no frontier for a while to which a path leads."""

    def __init__(
        self,
        tick: int,
        searched: bool,
        search_rate: tuple[float, ...],
        merged: int,
        victims_found: tuple[int, ...] = (),
        silent: bool = False,
        exhausted: bool = False,
    ) -> None:
        self.tick = tick
        self.searched = searched
        self.search_rate = search_rate
        self.merged = merged
        self.victims_found = victims_found
        self.silent = silent
        self.exhausted = exhausted

    def encode(self) -> bytes:
        return pack((
            self.tick, self.searched, self.search_rate, self.merged, self.victims_found, self.silent, self.exhausted,
        ))  # fmt: skip

    @staticmethod
    def decode(data: bytes) -> Report:
        tick, searched, rates, merged, found, silent, exhausted = unpack(data, 7)
        if not isinstance(rates, list) or not isinstance(found, list):
            raise WireError("search rates and victims are lists")
        return Report(
            integer(tick, 0, MAX_TICK),
            boolean(searched),
            tuple(share(r) for r in rates),
            integer(merged, 0, MAX_TICK),
            tuple(integer(v, 0, MAX_NODE) for v in found),
            boolean(silent),
            boolean(exhausted),
        )


@dataclass(frozen=True, slots=True)
class Jam:
    """A region whose nodes hear nothing, or a pair of nodes that do not hear each other."""

    region_m: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1."""
    pair: tuple[int, int] | None = None


@dataclass(slots=True, init=False)
class Positions:
    """The roster of a tick and the true positions of its nodes: the medium's input."""

    tick: int
    nodes: NDArray[np.int16]
    """(n,) ids, ascending."""
    xy_m: NDArray[np.float64]
    """(n, 2) true positions."""
    jams: tuple[Jam, ...]
    loss: float
    """Frame-loss probability of a fault, on top of the radio's own."""

    def __init__(
        self,
        tick: int,
        nodes: NDArray[np.int16],
        xy_m: NDArray[np.float64],
        jams: tuple[Jam, ...] = (),
        loss: float = 0.0,
    ) -> None:
        self.tick = tick
        self.nodes = nodes
        self.xy_m = xy_m
        self.jams = jams
        self.loss = loss

    def encode(self) -> bytes:
        jams = [(j.region_m, j.pair) for j in self.jams]
        return pack((self.tick, self.nodes.astype(_I2).tobytes(), self.xy_m.astype(_F8).tobytes(), jams, self.loss))

    @staticmethod
    def decode(data: bytes) -> Positions:
        tick, nodes, xy, jams, loss = unpack(data, 5)
        ids = column(nodes, _I2)
        if (ids < 0).any() or (ids[1:] <= ids[:-1]).any() or not isinstance(jams, list):
            raise WireError("nodes are not ascending, or jams not a list")
        return Positions(
            integer(tick, 0, MAX_TICK), ids, places(xy, _F8, len(ids)), tuple(_jam(j) for j in jams), share(loss)
        )


def _jam(raw: Any) -> Jam:
    if not isinstance(raw, list) or len(raw) != 2:
        raise WireError("a jam is (region, pair)")
    region, pair = raw
    if region is not None:
        if not isinstance(region, list) or len(region) != 4:
            raise WireError("a region is x0, y0, x1, y1")
        x0, y0, x1, y1 = (coordinate(v) for v in region)
        return Jam(region_m=(x0, y0, x1, y1))
    if not isinstance(pair, list) or len(pair) != 2:
        raise WireError("a pair is two nodes")
    return Jam(pair=(integer(pair[0], 0, MAX_NODE), integer(pair[1], 0, MAX_NODE)))


@dataclass(frozen=True, slots=True)
class Departed:
    """From `tick` on, `node` takes no part until it is in a roster again."""

    tick: int
    node: int

    def encode(self) -> bytes:
        return pack((self.tick, self.node))

    @classmethod
    def decode(cls, data: bytes) -> Departed:
        tick, node = unpack(data, 2)
        return cls(integer(tick, 0, MAX_TICK), integer(node, 0, MAX_NODE))


@dataclass(frozen=True, slots=True)
class Stop:
    """The run ends after `tick`."""

    tick: int
    reason: str
    """searched | exhausted | time_limit | no_robots | interrupted | failed"""

    def encode(self) -> bytes:
        return pack((self.tick, self.reason))

    @classmethod
    def decode(cls, data: bytes) -> Stop:
        tick, reason = unpack(data, 2)
        return cls(integer(tick, 0, MAX_TICK), text(reason))
