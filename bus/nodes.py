"""Ids of nodes, and every name that a node has: node 0 is the monitor station, robots are 1..N.

| function       | robot 4   | station   | where it stands                                                    |
|----------------|-----------|-----------|--------------------------------------------------------------------|
| `node_name`    | `robot 4` | `station` | in a sentence: events, logs, messages to a user                    |
| `process_name` | `robot/4` | `station` | the process: its title, its log, `pids.json`                       |
| `user_name`    | `robot-4` | `station` | who logs in to the router, and whose counts and phases these are   |
| `target_name`  | `4`       | `station` | whom a fault hits, as a scenario and the command line have it      |
| `short_name`   | `4`       | `MS`      | in a table or a picture of the network; `-` for nobody             |
"""

from __future__ import annotations

from typing import Final

__all__ = [
    "MAX_NODE", "NOBODY", "STATION", "node_name", "node_of_user", "process_name", "short_name", "target_name",
    "user_name",
]  # fmt: skip

STATION: Final = 0
"""Node id of the monitor station."""

NOBODY: Final = -1
"""Stands for "no node" where a node id is expected."""

MAX_NODE: Final = 32_766
"""Ids fit an int16 column."""


def node_name(node: int) -> str:
    """Name of a node in a sentence."""
    return _named(node, " ")


def process_name(node: int) -> str:
    """Name of a node's process."""
    return _named(node, "/")


def user_name(node: int) -> str:
    """Name under which a node logs in. It is a chunk of keys, so it has no `/`."""
    return _named(node, "-")


def node_of_user(user: str) -> int | None:
    """The node that logs in as `user`; None for a user that is no node (world, medium, operator)."""
    if user == "station":
        return STATION
    return int(user.removeprefix("robot-")) if user.startswith("robot-") else None


def target_name(node: int) -> str:
    """A node as the target of a fault."""
    return str(node) if node != STATION else "station"


def short_name(node: int) -> str:
    """A node in a table or a picture."""
    return {STATION: "MS", NOBODY: "-"}.get(node) or str(node)


def _named(node: int, joint: str) -> str:
    return f"robot{joint}{node}" if node != STATION else "station"
