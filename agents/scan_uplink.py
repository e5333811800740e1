"""Scans on their way up: numbered reports, sent to the NMS and kept until the MS acknowledges them [paper 7.5].

With an unlimited radio each scan is one report, and is sent again after twice the round trip by hops. With a limited
one a scan waits until the radio has room, and becomes as many reports as it needs, each of which fits into half of
what a tick adds. At most `window` of them are under way, and each is sent again after the measured round trip
(round_trip.py). What does not leave now, be it own or carried, leaves later.
"""

from __future__ import annotations

from collections import deque
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agents.config import Reporting
from agents.messages import ACK, AHEAD, ScanReport, body_of, one_hop_on
from agents.room import Room
from agents.round_trip import RoundTrip
from bus.codec import WireError
from world.terms import tick_of

Scan: TypeAlias = tuple[int, NDArray[np.uint32], NDArray[np.int8], tuple[tuple[int, float, float], ...]]
"""A scan: its tick, the cells that it is evidence for and their values, and the victims that it saw."""

_USUAL_BYTES: Final = 240
"""A report may be so long though that is more than half a share, or else its head would take more than its cells."""
_MOST_CARRIED: Final = 1000
"""Reports of others beyond that are dropped; their origins send them again."""


class ScanUplink:
    """The reports of one incarnation of a robot, and those that it carries for other robots."""

    def __init__(self, node: int, incarnation: int, rules: Reporting, *, limited: bool = False) -> None:
        """`limited`: whether the radio is."""
        self._node = node
        self._incarnation = incarnation
        self._resend_min_ticks = tick_of(rules.resend_min_s)
        self._limited = limited
        self._window = rules.window
        self._waiting: deque[Scan] = deque()
        """Scans, and what is left of the first one, that are in no report yet."""
        self._unacknowledged: dict[int, bytes] = {}
        self._ahead: frozenset[int] = frozenset()
        """Those of them that the MS said it has, though it lacks one before."""
        self._sent_tick: dict[int, int] = {}
        self._times_sent: dict[int, int] = {}
        self._round_trip = RoundTrip()
        self._carried: deque[bytes] = deque()
        self._kept: frozenset[bytes] = frozenset()
        """Bodies of those of them that did not leave in the tick in which they came: a copy that comes is dropped."""
        self._acks = b""
        self._ahead_acks = b""
        self._ack = ACK.pack(node, incarnation, 0)[:4]
        """First bytes of the ACK for this incarnation."""
        self._numbered = 0
        self._numbered_tick = 0
        """Of the scan that the last of them shows."""
        self._new: list[tuple[int, NDArray[np.uint32], NDArray[np.int8]]] = []
        """Reports that nobody has asked for yet."""
        self.discarded = 0
        self._sent = 0
        """The highest number that was ever sent."""
        self.acknowledged = 0
        """The MS has all reports up to this number."""

    @property
    def made(self) -> int:
        """Number of reports that were made. Scans that wait are the next one."""
        return self._numbered + bool(self._waiting)

    @property
    def newest_scan_tick(self) -> int:
        """Of the scan that the last report made shows; 0 before the first."""
        return self._waiting[0][0] if self._waiting else self._numbered_tick

    @property
    def buffered(self) -> int:
        """Number of reports that the MS has not acknowledged."""
        return len(self._unacknowledged) + bool(self._waiting)

    def make(
        self,
        tick: int,
        cells: NDArray[np.uint32],
        values: NDArray[np.int8],
        victims: tuple[tuple[int, float, float], ...],
    ) -> None:
        """Make the next report of a scan of this tick, and keep it; where the radio is limited, later and in parts."""
        self._waiting.append((tick, cells, values, victims))
        if not self._limited:
            self._number(len(cells))

    def _number(self, most_cells: int) -> None:
        """Make the next report of the first scan that waits, of at most so many cells."""
        tick, cells, values, victims = self._waiting.popleft()
        if len(cells) > most_cells:
            self._waiting.appendleft((tick, cells[most_cells:], values[most_cells:], ()))
            cells, values = cells[:most_cells], values[:most_cells]
        self._numbered += 1
        self._numbered_tick = tick
        report = ScanReport(self._node, self._incarnation, self._numbered, cells, values, victims)
        self._unacknowledged[self._numbered] = report.encode()
        self._new.append((self._numbered, cells, values))

    def numbered(self) -> list[tuple[int, NDArray[np.uint32], NDArray[np.int8]]]:
        """Number, cells and values of the reports that were made since the last call."""
        new, self._new = self._new, []
        return new

    def carry(self, report: bytes) -> None:
        """Take a report of another robot, to pass it on. Without a route it is dropped, and its origin sends it again.

        Raises:
            WireError: not a scan report.
        """
        onward = one_hop_on(report)
        if onward is not None and body_of(onward) not in self._kept and len(self._carried) < _MOST_CARRIED:
            self._carried.append(onward)

    def acknowledge(self, tick: int, acks: bytes, ahead: bytes = b"") -> None:
        """Forget the reports that the MS has; do not repeat those that it has ahead of one that it lacks.

        Raises:
            WireError: it can't have them, for they were never sent.
        """
        if acks == self._acks and ahead == self._ahead_acks:
            return
        self._acks, self._ahead_acks = acks, ahead
        at = _find(acks, self._ack, ACK.size)
        if at >= 0:
            _, _, upto = ACK.unpack_from(acks, at)
            self._check_sent(upto)
            self.acknowledged = max(self.acknowledged, upto)
            for number in [n for n in self._unacknowledged if n <= upto]:
                self._arrived(tick, number)
                del self._unacknowledged[number]
        at = _find(ahead, self._ack, AHEAD.size)
        self._ahead = frozenset()
        if at >= 0:
            _, _, upto, mask = AHEAD.unpack_from(ahead, at)
            numbers = frozenset(upto + 2 + bit for bit in range(mask.bit_length()) if mask >> bit & 1)
            self._check_sent(max(numbers, default=0))
            self._ahead = numbers
            for number in sorted(numbers):
                self._arrived(tick, number)

    def _check_sent(self, number: int) -> None:
        if number > self._sent:
            raise WireError("a report is acknowledged that was never sent")

    def _arrived(self, tick: int, number: int) -> None:
        """A report is at the MS, which is told for the first time, or again."""
        sent_tick = self._sent_tick.pop(number, None)
        if self._times_sent.pop(number, 0) == 1 and sent_tick is not None:
            self._round_trip.measure(tick - sent_tick)

    def due(self, tick: int, hops: int, room: Room) -> list[bytes]:
        """Payloads to send to the NMS now, over a route of `hops`: carried, new and overdue reports.

        A report is overdue after twice the round trip, and a hop costs one tick each way; with a limited radio, after
        the measured round trip, if that is longer.
        """
        payloads = []
        while self._carried and room.take(len(self._carried[0])):
            payloads.append(self._carried.popleft())
        self._kept = frozenset(map(body_of, self._carried))
        least = max(self._resend_min_ticks, 2 * 2 * hops)
        self._fill_window(room)
        for number, payload in self._unacknowledged.items():
            if number in self._ahead or not self._overdue(tick, number, least):
                continue
            if not room.take(len(payload)):
                break
            payloads.append(payload)
            self._sent_tick[number] = tick
            self._times_sent[number] = self._times_sent.get(number, 0) + 1
            self._sent = max(self._sent, number)
        return payloads

    def _overdue(self, tick: int, number: int, least: int) -> bool:
        sent_tick = self._sent_tick.get(number)
        if sent_tick is None:
            return True
        if not self._limited:
            return tick - sent_tick >= least
        return tick - sent_tick >= self._round_trip.patience_ticks(least, self._times_sent[number])

    def _fill_window(self, room: Room) -> None:
        """Make a report, at most one in a tick, if scans wait and one more may be under way."""
        if self._waiting and len(self._unacknowledged) < self._window:
            victims = self._waiting[0][3]
            most = max(room.share // 2, min(2 * room.share, _USUAL_BYTES))
            fits = most - ScanReport.HEAD_BYTES - ScanReport.VICTIM_BYTES * len(victims)
            self._number(max(fits // ScanReport.CELL_BYTES, 1))

    def drop_carried(self) -> None:
        """Drop carried reports, for want of a route; their origins send them again."""
        self._carried.clear()
        self._kept = frozenset()


def _find(rows: bytes, first: bytes, size: int) -> int:
    """Where the row of that size begins with those bytes; -1 if none does."""
    at = rows.find(first)
    while at >= 0 and at % size:
        at = rows.find(first, at + 1)
    return at
