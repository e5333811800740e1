"""Wire form of every message: msgpack, with numpy columns as raw little-endian bytes.

Messages of every tick have a fixed head instead (`struct.Struct`), at a fifth of the cost. The message that holds a
column fixes its dtype, never the sender. A malformed message raises `WireError` here, so it never reaches a core: a
peer's bad message is data, not an exception of ours (ARCHITECTURE.md, invariant 5).

**How message classes are written.** A message of every tick is a `@dataclass(slots=True, init=False)` with a
constructor written by hand. mypyc never compiles the constructor that `dataclass` writes, which takes 0.15 us where
one by hand takes 0.02 us. `frozen` would assign through `object.__setattr__` and cost still more, so these classes
are not frozen, but nobody changes a message. A rare message (a departure, a signal, the stop, an event, a forwarding
table to show) is a frozen dataclass. Each has `encode()`, and `decode(bytes)`, which raises `WireError`.
"""

from __future__ import annotations

import struct
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "MOST_METRES", "WireError", "all_finite", "boolean", "column", "coordinate", "finite", "head", "integer",
    "of_json_types", "pack", "places", "share", "text", "unpack", "unpack_map", "unpacked", "within",
]  # fmt: skip

MOST_METRES: Final = 1e8
"""No coordinate is larger: the surface of the Earth is 4e7 m around."""
_MOST_NESTED: Final = 12
"""Lists and maps within one another of JSON types."""

_pack: Final = msgpack.Packer().pack
"""One packer for all messages: `msgpack.packb` makes one for each, which costs as much as the packing."""


class WireError(ValueError):
    """A message without the form that its key or kind promises."""


def pack(fields: tuple[Any, ...]) -> bytes:
    """Pack the fields of one message. Arrays must be raw bytes already (`ndarray.tobytes`)."""
    packed: bytes = _pack(fields)
    return packed


def unpacked(data: Any) -> Any:
    """Whatever was packed.

    Raises:
        WireError: the data is not bytes, or not msgpack.
    """
    if type(data) is not bytes:
        raise WireError("not bytes")
    try:
        return msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise WireError(f"not msgpack: {type(error).__name__}") from None


def unpack(data: Any, length: int) -> list[Any]:
    """Unpack a message of exactly `length` fields.

    Raises:
        WireError: the data is not bytes, not msgpack, not a list, or has another number of fields.
    """
    fields = unpacked(data)
    if not isinstance(fields, list) or len(fields) != length:
        raise WireError(f"expected a list of {length} fields")
    return fields


def unpack_map(data: Any) -> dict[str, Any]:
    """Unpack a map of names to values of JSON types.

    Raises:
        WireError: it is none.
    """
    fields = of_json_types(unpacked(data))
    if not isinstance(fields, dict):
        raise WireError("not a map")
    return fields


def head(layout: struct.Struct, data: Any) -> tuple[Any, ...]:
    """Unpack the fixed head of a message. The rest of the message begins at `layout.size`.

    Raises:
        WireError: the data is not bytes, or too short.
    """
    if type(data) is not bytes or len(data) < layout.size:
        raise WireError(f"shorter than a head of {layout.size} bytes")
    return layout.unpack_from(data)


def column(raw: Any, dtype: np.dtype[Any], length: int | None = None) -> NDArray[Any]:
    """Read a raw column as a read-only view of shape (n,).

    Raises:
        WireError: not bytes, or not a whole number of items, or not `length` items.
    """
    if not isinstance(raw, bytes) or len(raw) % dtype.itemsize:
        raise WireError(f"not a column of {dtype}")
    values: NDArray[Any] = np.frombuffer(raw, dtype)
    if length is not None and len(values) != length:
        raise WireError(f"expected {length} items, got {len(values)}")
    return values


def within(values: NDArray[Any], low: int, high: int) -> NDArray[Any]:
    """Check a column of integers in low..high (both included)."""
    if values.size and not low <= values.min() <= values.max() <= high:
        raise WireError(f"not all in {low}..{high}")
    return values


def places(raw: Any, dtype: np.dtype[Any], length: int) -> NDArray[Any]:
    """Read raw coordinates in metres as a read-only view of shape (length, 2)."""
    values = column(raw, dtype, 2 * length)
    if values.size and not np.abs(values).max() <= MOST_METRES:
        raise WireError("not all are coordinates")
    return values.reshape(length, 2)


def all_finite(values: NDArray[np.float64]) -> bool:
    """Whether no value is infinite or NaN; for short columns three times as fast as `np.isfinite(values).all()`."""
    return b"\0" not in np.isfinite(values).tobytes()


def integer(value: Any, low: int, high: int) -> int:
    """Check an integer in low..high (both included)."""
    if type(value) is not int or not low <= value <= high:
        raise WireError(f"not an integer in {low}..{high}")
    return value


def finite(value: Any) -> float:
    """Check a finite number."""
    if type(value) is not float or value - value != 0.0:
        raise WireError("not a finite float")
    return value


def share(value: Any) -> float:
    """Check a share or a probability."""
    if type(value) is not float or not 0.0 <= value <= 1.0:
        raise WireError("not a share of 0..1")
    return value


def coordinate(value: Any) -> float:
    """Check a coordinate in metres."""
    if type(value) is not float or not -MOST_METRES <= value <= MOST_METRES:
        raise WireError("not a coordinate")
    return value


def boolean(value: Any) -> bool:
    """Check a boolean."""
    if type(value) is not bool:
        raise WireError("not a boolean")
    return value


def text(value: Any, longest: int = 10_000) -> str:
    """Check a text."""
    if type(value) is not str or len(value) > longest:
        raise WireError("not a text of fitting length")
    return value


def of_json_types(value: Any, nested: int = _MOST_NESTED) -> Any:
    """Check that a value is of JSON types, its numbers finite, and nested no deeper than `nested`."""
    if isinstance(value, list | dict):
        if not nested:
            raise WireError("nested too deeply")
        if isinstance(value, dict) and not all(type(name) is str for name in value):
            raise WireError("a name is not a text")
        for item in value.values() if isinstance(value, dict) else value:
            of_json_types(item, nested - 1)
    elif type(value) is float:
        finite(value)
    elif value is not None and type(value) not in (bool, int, str):
        raise WireError("not of a JSON type")
    return value
