"""Scans on their way up: numbered reports, sent to the NMS and kept until the MS acknowledges them [paper 7.5]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.config import Reporting
from agents.messages import ACK, ScanReport, one_hop_on
from bus.codec import WireError
from world.terms import TICK_S


class ScanUplink:
    """The reports of one incarnation of a robot, and those that it carries for other robots."""

    def __init__(self, node: int, incarnation: int, rules: Reporting) -> None:
        self._node = node
        self._incarnation = incarnation
        self._resend_min_ticks = round(rules.resend_min_s / TICK_S)
        self._unacknowledged: dict[int, bytes] = {}
        self._sent_tick: dict[int, int] = {}
        self._carried: list[bytes] = []
        self._acks = b""
        self._ack = ACK.pack(node, incarnation, 0)[:4]
        """First bytes of the ACK for this incarnation."""
        self.made = 0
        self.discarded = 0
        self._sent = 0
        """The highest number that was ever sent."""
        self.acknowledged = 0
        """The MS has all reports up to this number."""

    @property
    def buffered(self) -> int:
        """Number of reports that the MS has not acknowledged."""
        return len(self._unacknowledged)

    def make(
        self, cells: NDArray[np.uint32], values: NDArray[np.int8], victims: tuple[tuple[int, float, float], ...]
    ) -> int:
        """Make the next report of a scan, and keep it; returns its number."""
        self.made += 1
        report = ScanReport(self._node, self._incarnation, self.made, cells, values, victims)
        self._unacknowledged[self.made] = report.encode()
        return self.made

    def carry(self, report: bytes) -> None:
        """Take a report of another robot, to pass it on. Without a route it is dropped, and its origin sends it again.

        Raises:
            WireError: not a scan report.
        """
        if (onward := one_hop_on(report)) is not None:
            self._carried.append(onward)

    def acknowledge(self, acks: bytes) -> None:
        """Forget the reports that the MS has.

        Raises:
            WireError: it can't have them, for they were never sent.
        """
        if acks == self._acks:
            return
        self._acks = acks
        at = acks.find(self._ack)
        while at >= 0 and at % ACK.size:
            at = acks.find(self._ack, at + 1)
        if at >= 0:
            _, _, upto = ACK.unpack_from(acks, at)
            if upto > self._sent:
                raise WireError("a report is acknowledged that was never sent")
            self.acknowledged = max(self.acknowledged, upto)
            for number in [n for n in self._unacknowledged if n <= upto]:
                del self._unacknowledged[number]
                self._sent_tick.pop(number, None)

    def due(self, tick: int, hops: int) -> list[bytes]:
        """Payloads to send to the NMS now, over a route of `hops`: carried, new and overdue reports.

        A report is overdue after twice the round trip; a hop costs one tick each way.
        """
        carried, self._carried = self._carried, []
        patience = max(self._resend_min_ticks, 2 * 2 * hops)
        late = [n for n in self._unacknowledged if tick - self._sent_tick.get(n, -patience) >= patience]
        for number in late:
            self._sent_tick[number] = tick
            self._sent = max(self._sent, number)
        return carried + [self._unacknowledged[n] for n in late]

    def drop_carried(self) -> None:
        """Drop carried reports, for want of a route; their origins send them again."""
        self._carried.clear()
