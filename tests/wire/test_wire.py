"""docs/wire.md and the golden vectors are as the product speaks, and the page's tables read the vectors."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import msgpack
import pytest

from bus.lockstep import seal
from tests.wire import page, vectors
from tests.wire.vectors import ALL, Vectors, meaning

BY_NAME = {message.name: message for message in ALL}
HEADS = {
    "header": "header", "part": "part", "Sense": "sense", "Inbox": "inbox", "Motion": "motion", "row": "row",
    "acknowledgement": "ack", "acknowledgement beyond a gap": "ahead", "Answer": "answer", "Turn": "turn",
}  # fmt: skip
"""Tables of fixed places whose fields stand at the beginning of a vector, and the name of its file."""
LISTS = {
    "Transmission": "transmission",
    "Update": "update",
    "MapChunk": "map_chunk",
    "Stop": "stop",
    "Refused": "refused",
}


def test_the_page_has_every_table_as_it_is_made_today() -> None:
    text = page.PAGE.read_text(encoding="utf-8")
    assert sorted(page.asked(text)) == sorted(page.tables())
    assert page.filled(text) == text, "python -m tests.wire writes the tables anew"


@pytest.mark.parametrize("message", ALL, ids=lambda message: message.name)
def test_a_vector_is_what_the_product_writes_and_reads(message: Vectors) -> None:
    kept = message.kept()
    for vector in kept["vectors"]:
        assert meaning(message.decode(bytes.fromhex(vector["bytes"]))) == vector["meaning"]
    assert kept == message.made(), "an encoding has changed: raise WIRE_VERSION, then python -m tests.wire"


def test_every_file_of_vectors_is_held() -> None:
    assert {path.stem for path in vectors.FOLDER.iterdir()} == BY_NAME.keys()


@pytest.mark.parametrize("table", HEADS)
def test_the_table_of_fixed_places_reads_the_vectors(table: str) -> None:
    places, read = list(page.FIXED[table].places()), 0
    for vector in BY_NAME[HEADS[table]].kept()["vectors"]:
        data, told = bytes.fromhex(vector["bytes"]), flat(vector["meaning"])
        for at, code, name in places:
            (value,) = struct.unpack_from("<" + code, data, at)
            if name in told:
                read += 1
                assert value == told[name], name
    assert read or table == "Turn"


def test_the_table_of_receptions_reads_the_vectors() -> None:
    for vector in BY_NAME["inbox"].kept()["vectors"]:
        assert receptions(bytes.fromhex(vector["bytes"])) == vector["meaning"]["receptions"]


def receptions(data: bytes) -> list[list[Any]]:
    """Those of an inbox, by the tables alone."""
    head, at, found = page.FIXED["reception"].layout, page.FIXED["Inbox"].layout.size, []
    while at < len(data):
        src, power_dbm, length = head.unpack_from(data, at)
        at += head.size + length
        found.append([src, power_dbm, data[at - length : at].hex()])
    return found


def flat(told: dict[str, Any]) -> dict[str, Any]:
    """The meaning of a message with that of its status in one map."""
    return {name: value for name, value in told.items() if name != "status"} | told.get("status", {})


@pytest.mark.parametrize("table", LISTS)
def test_the_table_of_a_list_reads_the_vectors(table: str) -> None:
    message = page.PACKED[table]
    for vector in BY_NAME[LISTS[table]].kept()["vectors"]:
        entries = msgpack.unpackb(bytes.fromhex(vector["bytes"]))
        rows = [line.split("|") for line in message.table().splitlines()[2:]]
        assert len(rows) - len(entries) in ((0, 1) if table == "Update" else (0,))
        for row, value in zip(rows, entries, strict=False):
            name = row[3].strip(" `")
            if name in vector["meaning"] and isinstance(value, int | str):
                assert vector["meaning"][name] == value


def test_an_encoding_can_not_change_under_its_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vectors, "FOLDER", tmp_path)
    header = BY_NAME["header"]
    header.write()
    before = header.path.read_text()
    other = Vectors("header", header.messages, lambda sealed: seal(*sealed)[1:], bytes)
    with pytest.raises(ValueError, match=r"header\.json: 'DATA' has changed: raise WIRE_VERSION"):
        other.write()
    assert header.path.read_text() == before
    more = Vectors("header", header.messages | {"PING": (4, 0, b"")}, header.encode, header.decode)
    more.write()
    assert len(header.kept()["vectors"]) == 4
    monkeypatch.setattr(vectors, "WIRE_VERSION", 2)
    other.write()
    assert header.kept()["wire_version"] == 2
