"""What a node can say that it did in a tick: whatever exceeds it is malformed."""

from __future__ import annotations

from bus.codec import WireError, integer
from world.messages import Motion, Report, Status
from world.terms import NOBODY, STATION, UNREACHABLE

__all__ = ["decode_word"]


def decode_word(node: int, tick: int, data: bytes, *, robots: int, cells: int) -> Motion | Report:
    """The motion of a robot in an answer of `tick`, or the station's report.

    Args:
        node: who answers.
        tick: of the answer.
        data: what it says.
        robots: N.
        cells: number of search cells, on which the station reports.

    Raises:
        WireError: it is none, is of another tick, or says what can't be.
    """
    said: Motion | Report
    if node != STATION:
        said = Motion.decode(data)
        _check(said.status, robots, said.tick)
    else:
        said = Report.decode(data)
        if len(said.search_rate) != cells:
            raise WireError("rates of other search cells")
    if said.tick != tick:
        raise WireError(f"a motion or report of tick {said.tick} in an answer of tick {tick}")
    return said


def _check(status: Status, robots: int, tick: int) -> None:
    integer(max(status.nms, status.msr, status.nmsr), NOBODY, robots)
    if status.hops != UNREACHABLE:
        integer(status.hops, 1, robots)
    if (status.nms == NOBODY) != (status.hops == UNREACHABLE):
        raise WireError("a route without a next hop, or a next hop without a route")
    # A robot scans at most once in a tick.
    integer(status.reports_made + status.reports_discarded, 0, tick + 1)
    integer(status.newest_scan_tick, 0, tick)
