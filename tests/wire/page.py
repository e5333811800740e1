"""The tables of docs/wire.md, made from the definitions of keys and messages.

A table stands between `<!-- made: NAME -->` and `<!-- end -->`. What a field is comes from the docstring beside it.
"""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import re
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final, get_type_hints

from agents.config import Reporting, RobotConfig, Routing
from agents.forwarding_table import _INHERENT, ROW
from agents.messages import ACK, AHEAD, MAP_CHUNK, MOST_HOPS, UPDATE, MapChunk, ScanReport, Update
from bus import access, envelopes, heartbeat, lockstep, mailbox
from bus.envelopes import Refused
from bus.keys import ROWS, WIRE_VERSION, Keys
from bus.lockstep import Kind
from bus.nodes import user_name
from medium import messages as radio
from medium.messages import Inbox, Transmission
from tests import ROOT
from world import messages as truth
from world.messages import Sense, Status, Stop

PAGE: Final = ROOT / "docs" / "wire.md"
_BLOCK: Final = re.compile(r"(<!-- made: ([\w ]+) -->\n).*?(<!-- end -->)", re.DOTALL)
_CODES: Final = {
    "?": "bool",
    "b": "i8",
    "B": "u8",
    "h": "i16",
    "H": "u16",
    "i": "i32",
    "I": "u32",
    "Q": "u64",
    "d": "f64",
}
_NAMES: Final = {int: "int", str: "str", bool: "bool", bytes: "bin"}


@dataclass(frozen=True)
class Fixed:
    """A message, or the head of one, whose fields have fixed places. Little-endian, without padding."""

    layout: struct.Struct
    fields: dict[str, str]
    """What each is, in order; empty: its docstring says so."""
    kind: Any = None
    """The class with these docstrings."""

    def places(self) -> Iterator[tuple[int, str, str]]:
        """(offset, code of `struct`, name) of each field."""
        assert self.layout.format[0] == "<"
        at, codes = 0, []
        for count, code in re.findall(r"(\d*)([a-zA-Z?])", self.layout.format):
            codes += [count + code] if code == "s" else [code] * int(count or 1)
        for code, name in zip(codes, self.fields, strict=True):
            yield at, code, name
            at += struct.calcsize("<" + code)
        assert at == self.layout.size

    def table(self) -> str:
        lines = ["| at | type | field | is |", "|---|---|---|---|"]
        for at, code, name in self.places():
            kind = _CODES.get(code, f"{code[:-1]} bytes")
            lines.append(f"| {at} | {kind} | `{name}` | {_cell(self.fields[name] or docs(self.kind)[name])} |")
        return "\n".join([*lines, f"| {self.layout.size} | | | the end of these fields |"])


@dataclass(frozen=True)
class Packed:
    """A message that is one msgpack list."""

    kind: Any
    ahead: dict[str, str] = field(default_factory=dict)
    """Entries before the fields of its class, and what they are."""
    other: dict[str, str] = field(default_factory=dict)
    """What fields are, beside or in place of their docstrings."""
    types: dict[str, str] = field(default_factory=dict)

    def table(self) -> str:
        lines = ["| entry | type | field | is |", "|---|---|---|---|"]
        hints, told = get_type_hints(self.kind), docs(self.kind)
        entries = [(name, "int", words) for name, words in self.ahead.items()]
        for f in fields(self.kind):
            words = self.other.get(f.name) or told[f.name]
            entries.append((f.name, self.types.get(f.name) or _NAMES[hints[f.name]], words))
        return "\n".join(
            [
                *lines,
                *(f"| {k} | {kind} | `{name}` | {_cell(words)} |" for k, (name, kind, words) in enumerate(entries)),
            ]
        )


_TICK: Final = "the tick"
_CELLS: Final = {"cells": "bin: u32 each"}

FIXED: Final = {
    "header": Fixed(
        lockstep._HEADER,
        {
            "kind": "see below",
            "incarnation": "of the process that it is for or from: the last chunk of its token; 0: of none",
        },
    ),
    "part": Fixed(
        mailbox._MARK,
        {
            "message": "the same for all parts of a message; a random number",
            "part": "counts from 0",
            "parts": "how many",
        },
    ),
    "Turn": Fixed(envelopes._TURN, {"length": "of the sense with its header, in bytes; the inbox is the rest"}),
    "Sense": Fixed(
        truth._SENSE,
        {
            "tick": _TICK,
            "first": "",
            "incarnation": "",
            "beams": "how many ranges follow; 2^32 - 1: no scan in this tick",
            "x_m": "own position",
            "y_m": "likewise",
        },
        Sense,
    ),
    "Inbox": Fixed(radio._HEAD, {"tick": _TICK, "room_bytes": "", "share_bytes": ""}, Inbox),
    "reception": Fixed(
        struct.Struct("<HdI"),
        {
            "src": "who sent it; the medium vouches for it",
            "rx_power_dbm": "received power",
            "length": "of the payload, which follows",
        },
    ),
    "Answer": Fixed(
        envelopes._ANSWER,
        {
            "tick": "of the turn",
            "length": "of the transmission, in bytes; the motion is the rest",
        },
    ),
    "Motion": Fixed(
        truth._MOTION,
        {
            "tick": "of the turn",
            "vx_m_s": "velocity until the next tick; the world caps it at the top speed",
            "vy_m_s": "likewise",
            "cls": "class: 0 search robot, 1 relay robot",
            "nms": "next hop to the MS, or -1",
            "msr": "a relay's master search robot, or -1",
            "nmsr": "next hop to it, or -1",
            "hops": "hop count to the MS, 1 to N; 255 exactly if `nms` is -1",
            "mode": "its `Mode` (`world/terms.py`): 0 walks, 1 and 2 recover a link, 3 has no route, 4 waits, 5 away",
            "target_x_m": "where it goes; shown only",
            "target_y_m": "likewise",
            "reports_made": "scan reports of this incarnation",
            "reports_buffered": "those of them that the MS has not acknowledged",
            "reports_discarded": "scans that were dropped; made and discarded are at most tick + 1",
            "newest_scan_tick": "tick of the scan that the last report made shows; 0 if none was made",
        },
        Status,
    ),
    "row": Fixed(
        ROW,
        {
            "dst": "a destination",
            "freshness": "sequence number x 256 + 255 - hop count",
            "inherent": "what the destination says of itself; passed on unread",
        },
    ),
    "inherent": Fixed(
        _INHERENT,
        {
            "flags": "bit 0: class (1 relay); bit 1: in need (policy `scout`); others 0",
            "x": "its position, in steps of 10 um",
            "y": "likewise",
            "target_x": "where it goes",
            "target_y": "likewise",
        },
    ),
    "acknowledgement": Fixed(
        ACK,
        {
            "robot": "whose reports",
            "incarnation": "of that robot",
            "number": "the MS has all of its reports up to this number",
        },
    ),
    "acknowledgement beyond a gap": Fixed(
        AHEAD,
        {
            "robot": "as above",
            "incarnation": "as above",
            "number": "as above",
            "mask": "bit b: the MS has report `number` + 2 + b, too",
        },
    ),
    "Beat": Fixed(heartbeat._SPENT, {"spent_s": ""}, heartbeat.Beat),
}
"""By the name of their table."""

PACKED: Final = {
    "Transmission": Packed(
        Transmission,
        other={"tick": "of the turn", "src": "this node", "frames": "`[dst, payload]` each, in order"},
        types={"frames": "list"},
    ),
    "Update": Packed(
        Update,
        {"kind": f"{UPDATE}"},
        {"nms": "next hop to the MS, or -1", "rows": "a sequence of rows, see below"},
    ),
    "ScanReport": Packed(
        ScanReport,
        other={
            "origin": "the robot that made it",
            "incarnation": "`Sense.incarnation` of that robot",
            "cells": "row x columns + column of the grid of `config.geometry`",
            "values": "0: missed, so free; 1: hit, so wall",
            "victims": "`[id, x_m, y_m]` each, those seen for the first time",
        },
        types=_CELLS | {"values": "bin: i8 each", "victims": "list"},
    ),
    "MapChunk": Packed(
        MapChunk,
        {"kind": f"{MAP_CHUNK}"},
        {
            "first": "number of the first change, from 0",
            "cells": "as above",
            "odds": "below 0: free; above 0: wall; 0: unknown",
        },
        _CELLS | {"odds": "bin: i8 each"},
    ),
    "Stop": Packed(Stop, other={"tick": "the last tick"}),
    "Refused": Packed(Refused),
}


@functools.cache
def docs(kind: type) -> dict[str, str]:
    """The docstring of each field of a class."""
    tree = ast.parse(Path(str(sys.modules[kind.__module__].__file__)).read_text(encoding="utf-8"))
    (body,) = [node.body for node in tree.body if isinstance(node, ast.ClassDef) and node.name == kind.__name__]
    found = {}
    for item, after in itertools.pairwise(body):
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name) and isinstance(after, ast.Expr):
            assert isinstance(after.value, ast.Constant)
            found[item.target.id] = inspect.cleandoc(str(after.value.value))
    return found


def _cell(words: str) -> str:
    """Words of a docstring as a table cell."""
    return " ".join(words.split()).replace("|", "\\|").removesuffix(".")


def _keys() -> str:
    """What a robot may put on and receive on."""
    keys = Keys("{run}")
    lines = ["| key | robot 4 | the other side |", "|---|---|---|"]
    for name, row in ROWS.items():
        sides = {"node", "robot"}
        does = [word for word, parties in (("puts", row.senders), ("receives", row.receivers)) if sides & set(parties)]
        if not does or (row.kind == "token" and "robot" in row.receivers):
            continue
        others = row.receivers if does[0] == "puts" else row.senders
        key = keys.key(name, node="4", process=user_name(4), version=WIRE_VERSION, incarnation="{incarnation}")
        if row.kind == "token":
            mine = does[0] == "puts"
            key = key if mine else keys.alive(name)
            does = ["shows as its token"] if mine else ["watches"]
        lines.append(f"| `{key}` | {does[0]} | {', '.join(others)} |")
    return "\n".join(lines)


def _kinds() -> str:
    rows = {Kind.DATA: "the message that belongs to the key", Kind.STOP: "`Stop`: the run is over",
            Kind.REFUSED: "`Refused`: the process that the header names takes no part"}  # fmt: skip
    return "\n".join(["| kind | is |", "|---|---|", *(f"| {kind.value} | {words} |" for kind, words in rows.items())])


def _config() -> str:
    lines = ["| key of `config` | is |", "|---|---|"]
    told = docs(RobotConfig)
    lines += [f"| `{f.name}` | {_cell(told[f.name])} |" for f in fields(RobotConfig)]
    return "\n".join(lines)


def _numbers() -> str:
    """Limits and times that an agent needs."""
    beats, routing, reporting = heartbeat.BEAT_S, Routing(), Reporting()
    again_s = reporting.resend_min_s
    rows = {
        "version of the wire": WIRE_VERSION,
        "longest message in one part, bytes": mailbox.PART_BYTES,
        "longest message that the router takes, bytes": access.MOST_BYTES,
        "time between two beats of our processes, s": beats,
        "beats that the router lets through, in a second": f"{access.MOST_BEATS_PER_S:g}",
        "neighbor time-out (`config.rules.routing.neighbor_timeout_ticks`), ticks": routing.neighbor_timeout_ticks,
        "silence (`config.rules.routing.silence_ticks`), ticks": routing.silence_ticks,
        "most changes of the map in a frame (`config.rules.reporting.chunk_cells`)": reporting.chunk_cells,
        "until a report is sent again, at least (`config.rules.reporting.resend_min_s`), s": f"{again_s:g}",
        "hops that a scan report may take": MOST_HOPS,
    }
    return "\n".join(["| number | is |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())])


def tables() -> dict[str, str]:
    """All tables, by name."""
    made = {name: message.table() for name, message in (FIXED | PACKED).items()}
    return made | {"keys": _keys(), "kinds": _kinds(), "config": _config(), "numbers": _numbers()}


def filled(text: str) -> str:
    """The page with its tables as they are today.

    Raises:
        KeyError: it asks for a table that there is not.
    """
    made = tables()
    return _BLOCK.sub(lambda found: f"{found[1]}{made[found[2]]}\n{found[3]}", text)


def asked(text: str) -> list[str]:
    """The tables that a page has."""
    return [found[2] for found in _BLOCK.finditer(text)]
