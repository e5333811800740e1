"""Which process stands for which node: who is there, who may return, and who is refused.

A node can have several processes at a time: one that hangs, and one that was started in its place. The *seat* of a
node belongs to the process that takes part or, while the node is away, to the one that may come back. The world ignores
what a process without a seat says.
"""

from __future__ import annotations

from enum import Enum

from bus.nodes import node_name

__all__ = ["Attendance", "Standing"]

_MOST_REFUSED = 16
"""Processes of one node that are told that they are refused. A node has a few; further tokens are made up."""


class Standing(Enum):
    """How the process in a seat stands."""

    PRESENT = "takes part, or will from the next tick on"
    PAUSED = "away by schedule, its process stopped"
    SILENT = "departed as hung, its process still there"
    SHUT_OUT = "departed for good, its process still there"


class Attendance:
    """The seats of a run."""

    def __init__(self) -> None:
        self._seats: dict[int, tuple[int, Standing]] = {}
        self._arriving: dict[int, bool] = {}
        self._refused: dict[int, set[int]] = {}
        """By node: processes that were told so."""

    def came(self, node: int, token: int) -> bool:
        """A process of `node` showed its token. Returns False if it is refused: another living process is that node."""
        seat = self._seats.get(node)
        if seat is not None and seat[0] != token and seat[1] not in (Standing.SILENT, Standing.SHUT_OUT):
            return False
        self._take(node, token, new=True)
        return True

    def refuse(self, node: int, token: int, mismatch: str) -> str:
        """A process that has no seat showed its token or answered; `mismatch`: how its version differs, if it does.

        Returns:
            What it must be told, which is once; then empty.
        """
        refused = self._refused.setdefault(node, set())
        if token in refused or len(refused) == _MOST_REFUSED:
            return ""
        refused.add(token)
        return mismatch or f"another living process is already {node_name(node)}"

    def left(self, node: int, token: int) -> bool:
        """A token of `node` dropped. Returns True if the core knows that process and must be told."""
        if not self.seated(node, token):
            return False
        del self._seats[node]
        return self._arriving.pop(node, None) is None

    def seated(self, node: int, token: int) -> bool:
        """Whether this process has the seat of `node`."""
        return node in self._seats and self._seats[node][0] == token

    def heard(self, node: int, token: int) -> None:
        """The process in the seat answered out of turn. If it was departed as hung, it has thawed."""
        if self._seats[node][1] is Standing.SILENT:
            self._take(node, token, new=False)

    def silent(self, node: int) -> None:
        """`node` was departed as hung."""
        self._stand(node, Standing.SILENT)

    def shut_out(self, node: int) -> None:
        """`node` was departed as a flood: no answer brings this process back."""
        self._stand(node, Standing.SHUT_OUT)

    def signalled(self, node: int, verb: str) -> None:
        """A scheduled fault acted on the process of `node`: kill, stop, cont or spawn."""
        if verb == "kill":
            # Its token drops later, perhaps after the token of its successor has come.
            self._seats.pop(node, None)
            self._arriving.pop(node, None)
        elif verb == "stop":
            self._stand(node, Standing.PAUSED)
        elif verb == "cont":
            self._stand(node, Standing.PRESENT)

    def token(self, node: int) -> int:
        """Token of the process in the seat; 0 if there is none."""
        return self._seats[node][0] if node in self._seats else 0

    def arrivals(self) -> list[tuple[int, bool]]:
        """(node, new) of each process that arrived since the last call, ascending."""
        arrived = sorted(self._arriving.items())
        self._arriving.clear()
        return arrived

    def _take(self, node: int, token: int, *, new: bool) -> None:
        self._seats[node] = (token, Standing.PRESENT)
        self._arriving[node] = new

    def _stand(self, node: int, standing: Standing) -> None:
        if node in self._seats:
            self._seats[node] = (self._seats[node][0], standing)
