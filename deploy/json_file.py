"""JSON files that runs and studies leave. Each holds one object; anything else is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from bus.user_file import read_text

__all__ = ["read_object"]

_MOST_BYTES: Final = 2**28


def read_object(path: Path) -> dict[str, Any]:
    """The object that a JSON file holds.

    Raises:
        ValueError: it can't be read, or holds something else.
    """
    text = read_text(path, _MOST_BYTES)
    try:
        told = json.loads(text)
    except RecursionError:
        raise ValueError(f"{shown(path)}: not JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{shown(path)}: not JSON: {shown(error)}") from None
    if not isinstance(told, dict):
        raise ValueError(f"{shown(path)}: not a JSON object")
    return told
