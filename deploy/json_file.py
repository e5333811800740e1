"""JSON files that runs and studies leave: whatever lies at the path, it is a table, or refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from world.user_file import read_text

__all__ = ["read_table"]

_MOST_BYTES: Final = 2**28


def read_table(path: Path) -> dict[str, Any]:
    """The table that a JSON file holds.

    Raises:
        ValueError: it can't be read, or holds something else.
    """
    text = read_text(path, _MOST_BYTES)
    try:
        table = json.loads(text)
    except RecursionError:
        raise ValueError(f"{shown(path)}: not JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{shown(path)}: not JSON: {shown(error)}") from None
    if not isinstance(table, dict):
        raise ValueError(f"{shown(path)}: not a table")
    return table
