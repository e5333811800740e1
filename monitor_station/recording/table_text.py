"""A forwarding table with the columns of Fig. 2 [paper 2.4], as a Markdown document."""

from __future__ import annotations

from typing import Final

from agents.messages import Table
from bus.nodes import short_name
from world.terms import STATION, TICK_S, UNREACHABLE, Cls

_STAR: Final = r"\*"
_CLASSES: Final = tuple(cls.name for cls in Cls)


def table_markdown(table: Table) -> str:
    """Columns dst, nxt, hop, location, inv, cls and msr; an infinite metric is printed as ∞."""
    lines = [
        f"**Robot {table.node}** at {table.tick * TICK_S:.1f} s",
        "",
        "| dst | nxt | hop | location (m) | inv | cls | msr |",
        "|:---|:---|---:|:---|:---:|:---:|:---:|",
    ]
    rows = zip(
        table.dst.tolist(), table.next_hop.tolist(), table.hop.tolist(), table.xy_m.tolist(),
        table.inv.tolist(), table.cls.tolist(), strict=True,
    )  # fmt: skip
    for dst, next_hop, hop, (x, y), inv, cls in rows:
        hops = "∞" if hop == UNREACHABLE else hop
        kind, mine = ("-", "-") if dst == STATION else (_CLASSES[cls], _STAR if dst == table.msr else "")
        mark = _STAR if inv else ""
        lines.append(
            f"| {short_name(dst)} | {short_name(next_hop)} | {hops} | ({x:.1f}, {y:.1f}) | {mark} | {kind} | {mine} |"
        )
    return "\n".join(lines)


def table_key(table: Table) -> bytes:
    """All that a reader would notice: every column but the locations."""
    columns = (table.dst, table.next_hop, table.hop, table.inv, table.cls)
    return b"|".join([str(table.msr).encode(), *(column.tobytes() for column in columns)])
