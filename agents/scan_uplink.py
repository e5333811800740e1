"""Scans on their way up: numbered reports, unicast hop by hop to the NMS, kept until the MS acknowledges them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.config import Reporting
from agents.messages import ACK, ScanReport, one_hop_on
from world.terms import TICK_S


class ScanUplink:
    """The reports of one robot incarnation, and those that it carries for others."""

    def __init__(self, node: int, incarnation: int, rules: Reporting) -> None:
        self._node = node
        self._incarnation = incarnation
        self._resend_min_ticks = round(rules.resend_min_s / TICK_S)
        self._unacknowledged: dict[int, bytes] = {}
        self._sent_tick: dict[int, int] = {}
        self._carried: list[bytes] = []
        self._acks = b""
        self._ack = ACK.pack(node, incarnation, 0)[:4]
        """How what the MS says of this incarnation begins."""
        self.made = 0
        self.discarded = 0

    @property
    def buffered(self) -> int:
        """Reports made that the MS has not acknowledged."""
        return len(self._unacknowledged)

    def make(
        self, cells: NDArray[np.uint32], values: NDArray[np.int8], victims: tuple[tuple[int, float, float], ...]
    ) -> None:
        """Number a report of what a scan changed, and keep it."""
        self.made += 1
        report = ScanReport(self._node, self._incarnation, self.made, cells, values, victims)
        self._unacknowledged[self.made] = report.encode()

    def carry(self, report: bytes) -> None:
        """Pass a report on that another robot sent through this one; without a route its origin will send it again.

        Raises:
            WireError: not a scan report.
        """
        if (onward := one_hop_on(report)) is not None:
            self._carried.append(onward)

    def acknowledge(self, acks: bytes) -> None:
        """Forget what the MS says that it has."""
        if acks == self._acks:
            return
        self._acks = acks
        at = acks.find(self._ack)
        while at >= 0 and at % ACK.size:
            at = acks.find(self._ack, at + 1)
        if at >= 0:
            _, _, upto = ACK.unpack_from(acks, at)
            for number in [n for n in self._unacknowledged if n <= upto]:
                del self._unacknowledged[number]
                self._sent_tick.pop(number, None)

    def due(self, tick: int, hops: int) -> list[bytes]:
        """Payloads to send to the NMS now, given a route of `hops`: carried ones, new ones, overdue ones.

        A report is overdue after twice the round trip; one hop costs a tick each way.
        """
        carried, self._carried = self._carried, []
        patience = max(self._resend_min_ticks, 2 * 2 * hops)
        late = [n for n in self._unacknowledged if tick - self._sent_tick.get(n, -patience) >= patience]
        for number in late:
            self._sent_tick[number] = tick
        return carried + [self._unacknowledged[n] for n in late]

    def drop_carried(self) -> None:
        """There is no route: what was to be passed on is lost here, and sent again by its origin."""
        self._carried.clear()
