"""What a node can say that it did in a tick: whatever exceeds it is malformed."""

from __future__ import annotations

from bus.codec import WireError, integer
from world.config import WorldConfig
from world.messages import Motion, Report, Status
from world.terms import NOBODY, STATION, UNREACHABLE

__all__ = ["decode_word"]


def decode_word(node: int, data: bytes, config: WorldConfig) -> Motion | Report:
    """The motion of a robot, or the station's report.

    Raises:
        WireError: it is none, or says what can't be.
    """
    if node != STATION:
        motion = Motion.decode(data)
        _check(motion.status, config.robots, motion.tick)
        return motion
    report = Report.decode(data)
    if len(report.search_rate) != len(config.cell_names):
        raise WireError("rates of other search cells")
    return report


def _check(status: Status, robots: int, tick: int) -> None:
    integer(max(status.nms, status.msr, status.nmsr), NOBODY, robots)
    if status.hops != UNREACHABLE:
        integer(status.hops, 1, robots)
    if (status.nms == NOBODY) != (status.hops == UNREACHABLE):
        raise WireError("a route without a next hop, or a next hop without a route")
    # A robot scans at most once in a tick.
    integer(status.reports_made + status.reports_discarded, 0, tick + 1)
