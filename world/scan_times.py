"""When the scans were made that the reports of the robots show: the world is told by each status."""

from __future__ import annotations

from array import array

from world.messages import Status

__all__ = ["ScanTimes"]


class ScanTimes:
    """Ticks of scans, by robot incarnation and number of the report."""

    def __init__(self, robots: int) -> None:
        self._now = [array("I") for _ in range(robots)]
        """Of the incarnations that take part now: tick k - 1 is that of report k."""
        self._before: dict[str, list[int]] = {}

    def note(self, row: int, status: Status) -> None:
        """Note the reports that a robot made since its last status, which is at most one if it missed no tick."""
        ticks = self._now[row]
        more = status.reports_made - len(ticks)
        if more > 0:
            ticks.extend([status.newest_scan_tick] * more)

    def renew(self, row: int, source: str) -> None:
        """Begin a new incarnation of a robot; the `source` ("4/0") is the one that was."""
        if self._now[row]:
            self._before[source] = self._now[row].tolist()
            self._now[row] = array("I")

    def final(self, sources: list[str]) -> dict[str, list[int]]:
        """All ticks by "robot/incarnation"; `sources` are those of now."""
        now = zip(sources, self._now, strict=True)
        return self._before | {source: ticks.tolist() for source, ticks in now if ticks}
