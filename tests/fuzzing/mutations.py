"""Turns a valid message into one that no honest peer sends: flips, cuts, joins, nests, and goes to extremes."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final

import msgpack

EXTREME_INTEGERS: Final = (
    0, 1, 2, 9, 10, 127, 128, 254, 255, 256, 32_766, 32_767, 65_535, 10**6, 2**31 - 1, 2**31, 2**32 - 1, 2**54, 2**62,
    2**63 - 1, 2**64 - 1, -1, -2, -(2**31), -(2**63),
)  # fmt: skip
EXTREME_FLOATS: Final = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-308, 1e4, -1e4, 1e8, -1e8, 1e9, 1e300, -1e300, 1.7e308, float("inf"), -float("inf"),
    float("nan"),
)  # fmt: skip
NESTINGS: Final = (1, 3, 100, 400, 500, 900, 1000, 1020, 1100, 5000)
_HERE: Final = b"<lists go here>"
"""Stands for lists within lists, which `packb` itself refuses to pack."""
LARGEST: Final = 200_000
"""Bytes of a mutated message."""


def mutated(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """One to four mutations of a message; `others` are valid ones, whose parts may get into it."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = rng.choice(_MUTATIONS)(rng, data, others)[:LARGEST]
    return data


def _flip(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(data or b"\0")
    for _n in range(rng.choice((1, 1, 2, 8))):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    start, end = sorted(rng.randrange(len(data) + 1) for _n in range(2))
    return rng.choice((data[:start], data[start:], data[:start] + data[end:]))


def _join(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    other = rng.choice(others) if others else rng.randbytes(40)
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _repeat(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    start, end = sorted(rng.randrange(len(data) + 1) for _n in range(2))
    return data[:end] + data[start:end] * rng.choice((1, 2, 50)) + data[end:]


def _overwrite(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    form = rng.choice("BHIQhiqfd")
    value: float = rng.choice(EXTREME_FLOATS if form in "fd" else EXTREME_INTEGERS)
    if form in "BHIQhiq":
        size = 8 * struct.calcsize("<" + form)
        value = int(value) % 2**size - (2 ** (size - 1) if form in "hiq" else 0)
    elif form == "f" and abs(value) > 3e38:
        value = float("inf")
    packed = struct.pack("<" + form, value)
    at = rng.randrange(len(data) + 1)
    return data[:at] + packed + data[at + len(packed) :]


def _noise(rng: random.Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return rng.choice((b"", rng.randbytes(rng.randrange(60)), data + rng.randbytes(9)))


def _nest(rng: random.Random, _data: bytes, _: Sequence[bytes]) -> bytes:
    return rng.choice((b"\x91", b"\x81\xa1a", b"[", b'{"a":', b"[{")) * rng.choice(NESTINGS) + rng.choice(
        (b"\x01", b"")
    )


def _refill(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Unpack it, change one field somewhere within, and pack it again."""
    try:
        fields = msgpack.unpackb(data, strict_map_key=False)
        packed = bytes(msgpack.packb(_with_another_field(rng, fields, others)))
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException):
        return _flip(rng, data, others)
    return packed.replace(bytes(msgpack.packb(_HERE)), b"\x91" * rng.choice(NESTINGS) + b"\x90")


def _with_another_field(rng: random.Random, value: Any, others: Sequence[bytes]) -> Any:
    if isinstance(value, list) and value and rng.random() < 0.9:
        at = rng.randrange(len(value))
        kept = list(value)
        kept[at] = _with_another_field(rng, kept[at], others)
        return kept
    if isinstance(value, dict) and value and rng.random() < 0.9:
        name = rng.choice(list(value))
        return value | {name: _with_another_field(rng, value[name], others)}
    if isinstance(value, bytes) and rng.random() < 0.8:
        return mutated(rng, value, others)
    if isinstance(value, int) and rng.random() < 0.4:
        return value + rng.choice((-2, -1, 1, 2, 10, 256))
    return rng.choice(_FIELDS)(rng)


_FIELDS: Final[tuple[Callable[[random.Random], Any], ...]] = (
    lambda rng: rng.choice(EXTREME_INTEGERS),
    lambda rng: rng.choice(EXTREME_FLOATS),
    lambda rng: rng.choice((None, True, False, b"", "", "x" * 20_000, b"\0" * 20_000, [], {}, {"a": 1}, [[]])),
    lambda rng: [rng.choice(EXTREME_INTEGERS) for _ in range(rng.choice((1, 3, 1000)))],
    lambda rng: rng.choice((_HERE,)),
)
_MUTATIONS: Final = (_flip, _flip, _cut, _join, _repeat, _overwrite, _overwrite, _noise, _nest, *(4 * (_refill,)))
