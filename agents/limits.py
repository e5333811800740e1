"""What an honest peer can have said by the tick in which it is heard; whatever exceeds it is malformed.

A frame is heard one tick after it was sent. So in tick k

    a node's id                             is at most N
    sequence number s, of h hops            s / 2 + h <= k - 1: a node issues 2 x tick, and a hop takes a tick
    hop count                               is 0 in the sender's own row, and nowhere else
    report n of a robot's incarnation i     i + n <= k: an incarnation takes a tick at least, and so does a report
    changes of the MS's map                 are to other odds than a cell had (`MapCopy`), in frames of limited length

`agents/_rows.pyx` checks what stands in long columns, in the same terms.
"""

from __future__ import annotations

from agents.config import RobotConfig
from agents.messages import MapChunk, ScanReport, Update
from bus.codec import WireError, integer


class Limits:
    """The limits of one run."""

    def __init__(self, config: RobotConfig) -> None:
        self._robots = config.robots
        self._geometry = config.geometry
        self._chunk_cells = config.rules.reporting.chunk_cells

    def decode_update(self, payload: bytes, tick: int) -> Update:
        """Decode an update; its rows are checked where they are merged.

        Raises:
            WireError: it is none, or names a node that there is not, or numbers that nobody can have reached.
        """
        return Update.decode(payload, self._robots, tick)

    def check_report(self, report: ScanReport, tick: int) -> None:
        """Check a scan report that arrives at the MS.

        Raises:
            WireError: it is of no robot, or later than any can be, or what it saw lies outside the grid.
        """
        integer(report.origin, 1, self._robots)
        integer(report.incarnation + report.number, 1, tick)
        if not self._geometry.holds(report.cells) or len(set(report.cells.tolist())) != len(report.cells):
            raise WireError("a cell lies outside the grid, or is there twice")
        if not all(self._geometry.covers(x, y) for _, x, y in report.victims):
            raise WireError("a victim lies outside the grid")

    def check_chunk(self, chunk: MapChunk) -> None:
        """Check the number of changes of the MS's map; what they change is checked by `MapCopy`.

        Raises:
            WireError: they are more than the MS sends at once.
        """
        integer(len(chunk.cells), 0, self._chunk_cells)
