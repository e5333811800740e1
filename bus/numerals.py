"""Numbers that somebody writes as text, in the digits 0 to 9: Python would also take other scripts' and underscores."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["decimal", "whole"]

_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,400}")
_DECIMAL: Final = re.compile(r"[+-]?([0-9]{1,400}(\.[0-9]*)?|\.[0-9]{1,400})([eE][+-]?[0-9]{1,9})?")


def whole(text: str) -> int:
    """A whole number such as 12.

    Raises:
        ValueError: it is none.
    """
    if not _WHOLE.fullmatch(text.strip()):
        raise ValueError("not a whole number such as 12")
    return int(text)


def decimal(text: str) -> float:
    """A number such as 0.5 or 1e3; one that is too large is infinite.

    Raises:
        ValueError: it is none.
    """
    if not _DECIMAL.fullmatch(text.strip()):
        raise ValueError("not a number such as 0.5")
    return float(text)
