"""Golden vectors: bytes as the product makes them, and what they mean. One file for each message, in tests/vectors."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from agents.forwarding_table import _INHERENT, _PER_METRE, ROW, ForwardingTable, freshness_of, hop_of
from agents.messages import ACK, AHEAD, MapChunk, ScanReport, Update
from bus.envelopes import Answer, Refused, Turn
from bus.heartbeat import Beat
from bus.keys import WIRE_VERSION, Keys, Token
from bus.lockstep import Kind, seal, unseal
from bus.mailbox import _MARK, PART_BYTES, in_parts
from medium.messages import BROADCAST, Inbox, Transmission
from tests import ROOT
from world.messages import Motion, Sense, Status, Stop
from world.terms import NOBODY, UNREACHABLE, Cls, Mode

FOLDER: Final = ROOT / "tests" / "vectors"


@dataclass(frozen=True)
class Vectors:
    """Those of one message."""

    name: str
    """Of the file."""
    messages: dict[str, Any]
    """By what is particular about each."""
    encode: Callable[[Any], bytes]
    decode: Callable[[bytes], Any]

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.name}.json"

    def made(self) -> dict[str, Any]:
        """The contents of the file, by the encodings of today."""
        vectors = []
        for about, message in self.messages.items():
            data = self.encode(message)
            vectors.append({"about": about, "bytes": data.hex(), "meaning": meaning(self.decode(data))})
        return {"wire_version": WIRE_VERSION, "vectors": vectors}

    def kept(self) -> dict[str, Any]:
        """The contents of the file as it is."""
        return json.loads(self.path.read_text(encoding="utf-8"))  # type: ignore[no-any-return]

    def write(self) -> None:
        """Write the file.

        Raises:
            ValueError: it has a vector of this version that the product does not make any more.
        """
        made = self.made()
        if self.path.exists() and (kept := self.kept())["wire_version"] == WIRE_VERSION:
            lost = [v["about"] for v in kept["vectors"] if v not in made["vectors"]]
            if lost:
                raise ValueError(f"{self.path.name}: '{lost[0]}' has changed: raise WIRE_VERSION of bus/keys.py first")
        self.path.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def meaning(value: Any) -> Any:
    """A message in JSON types: bytes in hex, arrays as lists."""
    if dataclasses.is_dataclass(value):
        return {f.name: meaning(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {name: meaning(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [meaning(item) for item in value]
    return value


def _row(row: dict[str, Any]) -> bytes:
    table = ForwardingTable(4)
    table.set_route(row["dst"], freshness_of(row["seqno"], row["hops"]), 5)
    table.set_inherent(row["dst"], row["cls"], row["at_m"], row["target_m"], need=row["need"])
    return table.advertised([row["dst"]])


def _row_of(data: bytes) -> dict[str, Any]:
    dst, freshness, inherent = ROW.unpack(data)
    flags, x, y, target_x, target_y = _INHERENT.unpack(inherent)
    return {
        "dst": dst, "freshness": freshness, "seqno": freshness >> 8, "hops": hop_of(freshness), "flags": flags,
        "cls": flags & 1, "need": bool(flags & 2), "at_m": [x / _PER_METRE, y / _PER_METRE],
        "target_m": [target_x / _PER_METRE, target_y / _PER_METRE],
    }  # fmt: skip


def _ahead_of(data: bytes) -> dict[str, Any]:
    robot, incarnation, number, mask = AHEAD.unpack(data)
    numbers = [number + 2 + bit for bit in range(64) if mask >> bit & 1]
    return {"robot": robot, "incarnation": incarnation, "number": number, "mask": mask, "numbers": numbers}


def _attachments() -> list[bytes]:
    """Of a message in three parts."""
    marks: list[bytes] = []
    with patch("bus.mailbox.random.getrandbits", lambda _: 0x01020304):
        in_parts(lambda _data, attachment: marks.append(attachment))(bytes(2 * PART_BYTES + 1))
    return marks


def _named(*names: str) -> Callable[[Sequence[Any]], dict[str, Any]]:
    return lambda values: dict(zip(names, values, strict=True))


_SCAN: Final = np.array([0.0, 1.5, 8.0])
_CELLS: Final = np.array([0, 1, 0x01020304], np.uint32)
_OWN: Final = {
    "dst": 4,
    "seqno": 84,
    "hops": 0,
    "cls": Cls.SR,
    "at_m": (12.5, 3.25),
    "target_m": (0.0, -7.00001),
    "need": False,
}
_VIA: Final = {
    "dst": 0,
    "seqno": 82,
    "hops": 2,
    "cls": Cls.RR,
    "at_m": (28.0, 35.0),
    "target_m": (28.0, 35.0),
    "need": True,
}
_UPDATE: Final = Update(5, NOBODY, 700, _row(_OWN) + _row(_VIA), ACK.pack(3, 0, 7) + ACK.pack(4, 1, 9), 690)

ALL: Final = (
    Vectors(
        "token",
        {"robot 4": Token("robot", 4, 0x0A1B2C3D), "the world": Token("world", 0, 7)},
        lambda token: Keys("run").token(token).encode(),
        lambda data: Keys.token_of(data.decode()),
    ),
    Vectors(
        "header",
        {kind.name: (kind, 0x0A1B2C3D, b"message") for kind in (Kind.DATA, Kind.STOP, Kind.REFUSED)},
        lambda sealed: seal(*sealed),
        lambda data: _named("kind", "incarnation", "message")(unseal(data)),
    ),
    Vectors(
        "part",
        {f"part {part} of 3": mark for part, mark in enumerate(_attachments())},
        bytes,
        lambda data: _named("message", "part", "parts")(_MARK.unpack(data)),
    ),
    Vectors(
        "turn",
        {"a turn": Turn(b"sense behind its header", b"inbox"), "a first turn": Turn(b"sense", b"")},
        Turn.encode,
        Turn.decode,
    ),
    Vectors(
        "sense",
        {
            "no scan": Sense(42, False, 1, 12.5, -3.25),
            "a scan": Sense(40, True, 0, 12.5, 3.25, _SCAN),
            "a scan, and two victims": Sense(45, False, 0, 12.5, 3.25, _SCAN, ((0, 1.5, 2.5), (17, -1.0, 300.0))),
        },
        Sense.encode,
        Sense.decode,
    ),
    Vectors(
        "inbox",
        {
            "nothing heard": Inbox(42, ()),
            "two frames, and a radio with limits": Inbox(42, ((3, -61.5, b"first"), (300, -70.25, b"")), 1200, 500),
        },
        Inbox.encode,
        Inbox.decode,
    ),
    Vectors("answer", {"an answer": Answer(42, b"transmission", b"motion")}, Answer.encode, Answer.decode),
    Vectors(
        "transmission",
        {
            "silence": Transmission(42, 4, ()),
            "a broadcast, and a frame to 5": Transmission(42, 4, ((BROADCAST, b"update"), (5, b"report"))),
        },
        Transmission.encode,
        Transmission.decode,
    ),
    Vectors(
        "motion",
        {
            "a robot without a route": Motion(42, 0.0, -0.25, Status()),
            "a relay": Motion(42, 0.125, 0.5, Status(Cls.RR, 5, 7, 8, 2, Mode.INNER, 12.5, -3.25, 9, 3, 1, 37)),
        },
        Motion.encode,
        Motion.decode,
    ),
    Vectors(
        "update",
        {
            "without a route": Update(NOBODY, NOBODY, 0, _row(_OWN), b""),
            "with a route and acknowledgements": _UPDATE,
            "with acknowledgements beyond a gap": Update(
                5, 6, 700, _row(_OWN), ACK.pack(4, 1, 9), 690, AHEAD.pack(4, 1, 9, 5)
            ),
        },
        Update.encode,
        Update.decode,
    ),
    Vectors(
        "row",
        {
            "the sender's own": _OWN,
            "of the MS, two hops away": _VIA,
            "broken": _VIA | {"seqno": 83, "hops": UNREACHABLE},
        },
        _row,
        _row_of,
    ),
    Vectors(
        "ack",
        {"robot 4 has 9 reports on the map": (4, 1, 9)},
        lambda ack: ACK.pack(*ack),
        lambda data: _named("robot", "incarnation", "number")(ACK.unpack(data)),
    ),
    Vectors("ahead", {"beyond a gap": (4, 1, 9, 0b1001)}, lambda ahead: AHEAD.pack(*ahead), _ahead_of),
    Vectors(
        "scan_report",
        {
            "cells": ScanReport(4, 1, 9, _CELLS, np.array([0, 1, 0], np.int8)),
            "a victim": ScanReport(4, 1, 10, _CELLS[:0], np.zeros(0, np.int8), ((17, 1.5, -2.5),)),
        },
        ScanReport.encode,
        ScanReport.decode,
    ),
    Vectors(
        "map_chunk",
        {"three changes": MapChunk(690, _CELLS, np.array([-1, 1, 0], np.int8))},
        MapChunk.encode,
        MapChunk.decode,
    ),
    Vectors("stop", {"searched": Stop(4200, "searched")}, Stop.encode, Stop.decode),
    Vectors(
        "refused",
        {"another process": Refused("another living process is already robot 4")},
        Refused.encode,
        Refused.decode,
    ),
    Vectors("beat", {"half a second at work": Beat(0x0A1B2C3D, 0.5)}, Beat.encode, Beat.decode),
)
