"""Every message is the same after encoding and decoding; any other bytes raise WireError only."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.messages import ACK, AHEAD, MapChunk, ScanReport, Table, Update
from bus.codec import WireError
from bus.envelopes import Answer, Moves, Opening, Refused, Turn
from medium.messages import UNLIMITED, Inbox, Transmission
from world.feed import Event, Snapshot
from world.messages import Departed, Jam, Motion, Positions, Report, Sense, Status, Stop
from world.terms import Mode

coordinate = st.floats(-1e6, 1e6)
tick = st.integers(0, 2**31 - 1)
node = st.integers(0, 32_766)
count = st.integers(0, 2**31 - 1)
places = st.lists(st.tuples(node, coordinate, coordinate), max_size=3).map(tuple)
pair = st.tuples(node, node)
region = st.tuples(coordinate, coordinate, coordinate, coordinate)


def column(
    dtype: Any, low: float = 0, high: float = 100, columns: int | None = None, n: int = 4
) -> st.SearchStrategy[Any]:
    elements: Any = st.integers(int(low), int(high)) if np.dtype(dtype).kind in "iu" else st.floats(low, high, width=32)
    return arrays(dtype, (n,) if columns is None else (n, columns), elements=elements)


def status_of(made: int) -> st.SearchStrategy[Status]:
    """Of a robot that made so many reports, of which it buffers some."""
    return st.builds(
        Status, st.integers(0, 1), st.integers(-1, 99), st.integers(-1, 99), st.integers(-1, 99), st.integers(0, 255),
        st.integers(0, max(Mode)), coordinate, coordinate, st.just(made), st.integers(0, made), count,
    )  # fmt: skip


ids = arrays(np.int16, (4,), elements=st.integers(0, 100), unique=True).map(np.sort)
"""Ascending, as nodes of a roster and destinations of a table are."""
robots = st.just(np.arange(1, 5, dtype=np.int16))
statuses = count.flatmap(status_of)
MESSAGES: list[st.SearchStrategy[Any]] = [
    st.builds(Sense, tick, st.booleans(), node, coordinate, coordinate, st.none() | column(np.float64), places),
    st.builds(Motion, tick, coordinate, coordinate, statuses),
    st.builds(Report, tick, st.booleans(), st.lists(st.floats(0, 1)).map(tuple), count, st.lists(node).map(tuple)),
    st.builds(
        Positions, tick, ids, column(np.float64, columns=2),
        st.lists(st.builds(Jam, region_m=region) | st.builds(Jam, pair=pair), max_size=2).map(tuple), st.floats(0, 1),
    ),
    st.builds(Departed, tick, node),
    st.builds(Refused, st.text(max_size=99)),
    st.builds(Stop, tick, st.sampled_from(["searched", "time_limit"])),
    st.builds(
        Snapshot, tick, robots, column(np.uint8, 0, 1), column(np.float64, columns=2), column(np.uint8, 0, 1),
        column(np.uint8, 0, max(Mode)), column(np.uint8), column(np.int16, -1, 4), column(np.int16, -1, 4),
        column(np.float64, columns=2), count,
        st.lists(st.floats(0, 1)).map(tuple), count, st.lists(node).map(tuple),
    ),
    st.builds(Event, tick, st.just("fault"), node, st.text(), st.dictionaries(st.text(), st.integers(-9, 9))),
    st.builds(
        Transmission, tick, node, st.lists(st.tuples(st.integers(-1, 99), st.binary()), max_size=3).map(tuple)
    ),
    st.builds(
        Inbox, tick, st.lists(st.tuples(node, coordinate, st.binary()), max_size=3).map(tuple),
        st.integers(0, UNLIMITED), st.integers(0, UNLIMITED),
    ),
    st.builds(
        Update, st.integers(-1, 99), st.integers(-1, 99), count, st.binary(),
        st.just(ACK.pack(1, 0, 1)), count, st.sampled_from([b"", AHEAD.pack(1, 0, 1, 5)]),
    ),
    st.builds(
        ScanReport, node, node, st.integers(1, 99),
        column(np.uint32), column(np.int8, 0, 1), places,
    ),
    st.builds(MapChunk, count, column(np.uint32), column(np.int8, 0, 1)),
    st.builds(
        Table, tick, node, st.integers(-1, 99), ids, column(np.int16, -1), column(np.uint8),
        column(np.float32, columns=2), column(np.uint8, 0, 1), column(np.uint8, 0, 1),
    ),
]  # fmt: skip
FIXED = Sense | Motion | Inbox
"""With a fixed head: almost anything of the right length is one of these."""
PACKED = [
    Refused,
    Report,
    Positions,
    Departed,
    Stop,
    Snapshot,
    Event,
    Transmission,
    Update,
    ScanReport,
    MapChunk,
    Table,
]


def plain(value: Any) -> Any:
    """A message as nested tuples, so that arrays compare."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value):
        return type(value).__name__, *(plain(getattr(value, f.name)) for f in dataclasses.fields(value))
    if isinstance(value, tuple | list):
        return tuple(plain(v) for v in value)
    return value


@settings(max_examples=200, deadline=None)
@given(st.one_of(MESSAGES))
def test_decode_undoes_encode(message: Any) -> None:
    assert plain(type(message).decode(message.encode())) == plain(message)


@pytest.mark.parametrize("kind", PACKED)
@settings(max_examples=30, deadline=None)
@given(data=st.binary(max_size=60))
def test_garbage_is_a_wire_error(kind: Any, data: bytes) -> None:
    with pytest.raises(WireError):
        kind.decode(data)


json = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.binary(max_size=9)
    | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=200, deadline=None)
@given(st.one_of(MESSAGES).filter(lambda message: not isinstance(message, FIXED)), st.data())
def test_one_wrong_field_is_read_or_refused_but_never_raises_anything_else(message: Any, data: st.DataObject) -> None:
    fields = msgpack.unpackb(message.encode(), strict_map_key=False)
    index = data.draw(st.integers(0, len(fields) - 1))
    fields[index] = data.draw(json)
    try:
        again = type(message).decode(msgpack.packb(fields))
    except WireError:
        return
    assert type(again) is type(message)


@pytest.mark.parametrize("kind", [Sense, Motion, Inbox])
def test_what_is_too_short_is_a_wire_error(kind: Any) -> None:
    for length in range(4):
        with pytest.raises(WireError):
            kind.decode(bytes(length))


@settings(max_examples=300, deadline=None)
@given(st.one_of(MESSAGES), st.data())
def test_wrong_bytes_are_read_or_refused_but_never_raise_anything_else(message: Any, data: st.DataObject) -> None:
    raw = message.encode()
    start = data.draw(st.integers(0, len(raw)))
    end = data.draw(st.integers(start, min(start + 9, len(raw))))
    try:
        again = type(message).decode(raw[:start] + data.draw(st.binary(max_size=9)) + raw[end:])
    except WireError:
        return
    assert type(again) is type(message)


envelopes = st.one_of(
    st.builds(Opening, st.binary(max_size=9), st.lists(st.tuples(count, st.binary(max_size=9)), max_size=4)),
    st.builds(
        Moves, st.lists(st.tuples(count, st.integers(0, 2**32 - 1), tick, st.binary(max_size=9)), max_size=4),
        st.integers(-1, 2**31 - 1), st.lists(st.tuples(count, st.integers(0, 2**32 - 1)), max_size=4),
    ),
    st.builds(Turn, st.binary(max_size=9), st.binary(max_size=9)),
    st.builds(Answer, tick, st.binary(max_size=9), st.binary(max_size=9)),
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(envelopes, st.data())
def test_what_travels_together_comes_apart_again_or_is_refused(envelope: Any, data: st.DataObject) -> None:
    """What is cut short is refused, or says what a shorter one says: then it encodes to that."""
    packed = envelope.encode()
    assert type(envelope).decode(packed).encode() == packed
    cut = packed[: data.draw(st.integers(0, len(packed)))]
    try:
        assert type(envelope).decode(cut).encode() == cut
    except WireError:
        assert cut != packed


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([Opening, Moves, Turn, Answer]), st.binary(max_size=60))
def test_garbage_is_no_envelope_or_encodes_to_itself(kind: Any, data: bytes) -> None:
    with contextlib.suppress(WireError):
        assert kind.decode(data).encode() == data
