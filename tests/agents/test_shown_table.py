"""A robot's forwarding table on its way to the recorder is one that a robot can have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents.messages import Table
from bus.codec import WireError

IDS, FLAGS = np.array([0, 2, 7], np.int16), np.array([0, 1, 0], np.uint8)


def table(**columns: Any) -> Table:
    good = {
        "dst": IDS,
        "next_hop": IDS - 1,
        "hop": FLAGS,
        "xy_m": np.zeros((3, 2), np.float32),
        "inv": FLAGS,
        "cls": FLAGS,
    }
    return Table(7, 1, 2, **good | columns)


@pytest.mark.parametrize(
    "columns",
    [
        {"dst": IDS[::-1]},
        {"dst": IDS - 1},
        {"next_hop": IDS - 3},
        {"inv": FLAGS + 1},
        {"cls": FLAGS + 1},
        {"xy_m": np.full((3, 2), np.nan, np.float32)},
        {"xy_m": np.full((3, 2), 1e30, np.float32)},
    ],
)
def test_a_table_that_cannot_be_is_malformed(columns: dict[str, Any]) -> None:
    with pytest.raises(WireError):
        Table.decode(table(**columns).encode())
    assert Table.decode(table().encode()).dst.tolist() == IDS.tolist()
