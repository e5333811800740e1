"""A name or value of somebody else's in a message of ours: never its whole length, whatever it is."""

from __future__ import annotations

from typing import Final

__all__ = ["shown"]

_MOST_SHOWN: Final = 70


def shown(value: object, most: int = _MOST_SHOWN) -> str:
    """A name or value for a message: one line, printable, and its middle left out where it is long."""
    try:
        text = str(value)[: 2**16]
    except (RecursionError, ValueError):  # nested too deeply, or a number of thousands of digits
        return "..."
    line = "".join(c if c.isprintable() else "?" for c in text)
    if len(line) <= most:
        return line
    ahead = most // 3
    return f"{line[:ahead]}...{line[ahead + 3 - most :]}"
