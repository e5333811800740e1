"""Every key expression of a run, and who puts and who receives on it, in one list.

All keys stand under `vds/{run}/`. Robot ids are chunks of their own (`tx/4`, not `tx-4`). Simulation traffic stands
under the verbatim chunk `@sim`. A wildcard never matches such a chunk, so no `**` can overhear the truth (Zenoh key
expressions, "verbatim chunks").
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from bus.codec import WireError
from bus.excerpt import shown
from bus.nodes import node_name

__all__ = ["ANY", "ROWS", "WIRE_VERSION", "Keys", "Row", "Token", "check_run"]

WIRE_VERSION: Final = 1
"""Version of all keys and encodings (docs/wire.md). It is in every token; a process of another version is refused."""

ANY: Final = "*"
"""Stands for every node, role or incarnation in a subscription."""

_NODE: Final = re.compile(r"/(?P<node>[0-9]{1,5})\Z")
_TOKEN: Final = re.compile(
    r"/alive/(?P<role>[a-z]+)/(?P<node>[0-9]{1,5})/(?P<version>[0-9]{1,5})/(?P<incarnation>[0-9a-f]{8})\Z"
)

Kind = Literal["put", "query", "token"]
Party = Literal["world", "medium", "station", "robot", "node", "operator"]
"""`node` is the station or a robot; on a key with {node} it is that node only."""


@dataclass(frozen=True)
class Row:
    """One key: who puts (or asks, or is alive) and who receives (or answers, or watches)."""

    pattern: str
    kind: Kind
    senders: tuple[Party, ...]
    receivers: tuple[Party, ...]


_PROCESS: Final = "/{node}/{version}/{incarnation}"

ROWS: Final[Mapping[str, Row]] = MappingProxyType({
    "word": Row("@sim/word/{node}", "put", ("world",), ("node",)),
    "positions": Row("@sim/positions", "put", ("world",), ("medium",)),
    "pong": Row("@sim/pong", "put", ("medium",), ("world",)),
    "tx": Row("@sim/tx/{node}", "put", ("node",), ("medium",)),
    "beat": Row("@sim/beat/{node}", "put", ("node",), ("world",)),
    "flood": Row("@sim/flood", "put", ("medium",), ("world",)),
    "moved": Row("@sim/moved", "put", ("medium",), ("world",)),
    "rx": Row("@sim/rx/{node}/{incarnation}", "put", ("medium",), ("node",)),
    "table": Row("@sim/table/{node}", "put", ("robot",), ("station",)),
    "phases": Row("@sim/phases/{process}", "put", ("world", "medium", "node"), ("operator",)),
    "event": Row("@sim/event", "put", ("world", "medium", "station"), ("station", "operator")),
    "feed": Row("@sim/feed", "put", ("world",), ("station", "operator")),
    "signal": Row("@sim/signal", "put", ("world",), ("operator",)),
    "absence": Row("@sim/absence", "put", ("operator",), ("world",)),
    "final": Row("@sim/final/{process}", "put", ("world", "medium", "station"), ("operator",)),
    "control": Row("@sim/control", "query", ("operator",), ("world",)),
    "world": Row("alive/world" + _PROCESS, "token", ("world",), ("medium", "node", "operator")),
    "medium": Row("alive/medium" + _PROCESS, "token", ("medium",), ("world", "node", "operator")),
    "station": Row("alive/station" + _PROCESS, "token", ("station",), ("world", "medium", "operator")),
    "robot": Row("alive/robot" + _PROCESS, "token", ("robot",), ("world", "medium", "operator")),
    "operator": Row("alive/operator" + _PROCESS, "token", ("operator",), ("medium",)),
})  # fmt: skip
"""The methods of `Keys` say which message each key carries."""


@dataclass(frozen=True)
class Token:
    """The liveliness token of one process: `alive/{role}/{node}/{version}/{incarnation}`."""

    role: str
    node: int
    """Node id; 0 for every process that is no robot."""
    incarnation: int
    """Random at each process start, so that no two processes share a key."""
    version: int = WIRE_VERSION
    """Of the keys and encodings that the process speaks."""

    @property
    def mismatch(self) -> str:
        """One line that names both versions if that process speaks another one than this process; else empty."""
        if self.version == WIRE_VERSION:
            return ""
        name = node_name(self.node) if self.role == "robot" else self.role
        return f"{name} speaks version {self.version} of the wire, not version {WIRE_VERSION}"


def check_run(run: str) -> str:
    """Check that a run's name can be one chunk of a key.

    Raises:
        ValueError: it is empty, or has a character with a meaning in key expressions.
    """
    if not run or run.startswith("@") or any(c in "/*$?#" or c.isspace() or not c.isprintable() for c in run):
        raise ValueError(
            f"'{shown(run)}' can't name a run: a key chunk has none of / * $ ? # nor spaces, nor starts with @"
        )
    return run


@dataclass(frozen=True)
class Keys:
    """The keys of one run; `ANY` for a node gives the wildcard."""

    run: str

    def __post_init__(self) -> None:
        check_run(self.run)

    def key(self, name: str, **chunks: object) -> str:
        """Fill in the row `name` of ROWS; chunks that are not given become wildcards."""
        fields = {"node": ANY, "process": ANY, "version": ANY, "incarnation": ANY} | chunks
        return f"vds/{self.run}/{ROWS[name].pattern.format(**fields)}"

    def word(self, node: int | str) -> str:
        """World -> that node: `Stop` or `Refused`, each behind a header (`bus.lockstep.seal`)."""
        return self.key("word", node=node)

    @property
    def positions(self) -> str:
        """World -> medium: `Opening` with the `Positions`, `Departed` or `Stop`, each behind a header."""
        return self.key("positions")

    @property
    def pong(self) -> str:
        """Medium -> world: an empty message, the answer to a ping and to the stop."""
        return self.key("pong")

    def tx(self, node: int | str) -> str:
        """Node -> medium: `Answer` behind a header, with a `Transmission` and, for the world, a `Motion` (or the
        station's `Report`).
        """
        return self.key("tx", node=node)

    @property
    def flood(self) -> str:
        """Medium -> world: `Flood`, of a node whose messages it does not hear any more."""
        return self.key("flood")

    @property
    def moved(self) -> str:
        """Medium -> world: `Moves`, the motions since the last such message, and whether a tick is complete."""
        return self.key("moved")

    def rx(self, node: int | str, incarnation: int | None = None) -> str:
        """Medium -> one process of that node: `Turn`, with the `Sense` from the world and an `Inbox`.

        Each process has a key of its own. Otherwise the turns of a new process would also go to its frozen predecessor,
        fill the link to it, and stop the sender.
        """
        return self.key("rx", node=node, incarnation=ANY if incarnation is None else f"{incarnation:08x}")

    def beat(self, node: int | str) -> str:
        """Node -> world: `bus.heartbeat.Beat`, from a process that is long at work on a turn."""
        return self.key("beat", node=node)

    def table(self, node: int | str) -> str:
        """Robot -> recorder: `Table`, outside the lockstep."""
        return self.key("table", node=node)

    def phases(self, process: str) -> str:
        """Any process (by its user) -> launcher: its `bus.phases.Phases` so far, outside the lockstep."""
        return self.key("phases", process=process)

    @property
    def event(self) -> str:
        """Simulation processes -> recorder, launcher: `Event`."""
        return self.key("event")

    @property
    def feed(self) -> str:
        """World -> recorder, launcher: batches of `Snapshot`, as `bus.lockstep.batch` packs them."""
        return self.key("feed")

    @property
    def signal(self) -> str:
        """World -> launcher: `Signal`."""
        return self.key("signal")

    @property
    def absence(self) -> str:
        """Launcher -> world: `Absence`, the answer to a signal `look`."""
        return self.key("absence")

    def final(self, process: str) -> str:
        """World, medium, station -> launcher at the end: msgpack map of that core's counts."""
        return self.key("final", process=process)

    @property
    def control(self) -> str:
        """Launcher, operator -> world: a command line; the answer is JSON."""
        return self.key("control")

    def alive(self, role: str, node: int | str = ANY, incarnation: str = ANY, version: int | str = ANY) -> str:
        """Liveliness tokens of a role."""
        return self.key(role, node=node, version=version, incarnation=incarnation)

    def token(self, token: Token) -> str:
        """The key of one token."""
        return self.alive(token.role, token.node, f"{token.incarnation:08x}", token.version)

    @staticmethod
    def kind_of(key: str) -> tuple[str, str]:
        """(row, node or process) of a key under `@sim`; the latter empty where the row has none."""
        kind, _, rest = key.partition("/@sim/")[2].partition("/")
        return kind, rest

    @staticmethod
    def node_of(key: str) -> int:
        """The node of a `word`, `table`, `tx` or `beat` key.

        Raises:
            WireError: its last chunk is no node.
        """
        found = _NODE.search(key)
        if found is None:
            raise WireError("a key ends in no node")
        return int(found["node"])

    @staticmethod
    def is_token(key: str) -> bool:
        """Whether a key is a liveliness token's."""
        return "/alive/" in key

    @staticmethod
    def token_of(key: str) -> Token:
        """Read a liveliness key.

        Raises:
            WireError: its last chunks, which that process has chosen, are not those of a token.
        """
        found = _TOKEN.search(key)
        if found is None:
            raise WireError("a token ends in a role, a node, a version and an incarnation")
        return Token(found["role"], int(found["node"]), int(found["incarnation"], 16), int(found["version"]))
