"""Events of a tick: differences between consecutive snapshots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bus.nodes import node_name
from world.feed import Event, Snapshot
from world.terms import NOBODY, STATION, UNREACHABLE, Cls, Mode

__all__ = ["changes"]


def changes(before: Snapshot, after: Snapshot, cell_names: tuple[str, ...] = ()) -> tuple[Event, ...]:
    """Events between two snapshots, by kind, then by node: roles, links lost and recovered, victims, the mission.

    Robots that joined or left in between have fault events instead.
    """
    events: list[Event] = []
    if before.cls.tobytes() != after.cls.tobytes():
        events += _roles(before, after)
    if before.hops.tobytes() != after.hops.tobytes():
        events += _links(before, after)
    if before.victims_found != after.victims_found:
        known = set(before.victims_found)
        events += [
            Event(after.tick, "victim", STATION, f"victim {victim} is reported to the MS", {"victim": victim})
            for victim in after.victims_found
            if victim not in known
        ]
    if before.search_rate != after.search_rate:
        events += _mission(before, after, cell_names)
    return tuple(events)


def _stayed(before: Snapshot, after: Snapshot) -> NDArray[np.bool_]:
    return (before.present & after.present).astype(bool)


def _roles(before: Snapshot, after: Snapshot) -> list[Event]:
    changed = np.flatnonzero((before.cls != after.cls) & _stayed(before, after))
    return [
        Event(after.tick, "role", robot, f"{node_name(robot)} is now {name}", {"cls": name})
        for robot, name in ((int(after.nodes[i]), Cls(int(after.cls[i])).name) for i in changed)
    ]


def _links(before: Snapshot, after: Snapshot) -> list[Event]:
    had, has = before.hops != UNREACHABLE, after.hops != UNREACHABLE
    events = []
    for i in np.flatnonzero((had != has) & _stayed(before, after)):
        robot = int(after.nodes[i])
        if has[i]:
            hops, nms = int(after.hops[i]), int(after.nms[i])
            where = "the MS" if nms == STATION else node_name(nms) if nms != NOBODY else "nobody"
            text = f"{node_name(robot)} has a route to the MS via {where}, hops: {hops}"
            events.append(Event(after.tick, "link", robot, text, {"recovered": True, "nms": nms, "hops": hops}))
        else:
            planned = after.mode[i] == Mode.AWAY
            text = f"{node_name(robot)} {'is on a sortie' if planned else 'lost its route to the MS'}"
            data = {"recovered": False} | ({"planned": True} if planned else {})
            events.append(Event(after.tick, "link", robot, text, data))
    return events


def _mission(before: Snapshot, after: Snapshot, cell_names: tuple[str, ...]) -> list[Event]:
    old = before.search_rate or (0.0,) * len(after.search_rate)
    events = []
    for i, rate in enumerate(after.search_rate):
        if rate >= 1.0 and (i >= len(old) or old[i] < 1.0):
            name = cell_names[i] if i < len(cell_names) else str(i + 1)
            events.append(Event(after.tick, "mission", STATION, f"cell {name} is searched", {"cell": name}))
    if events and min(after.search_rate) >= 1.0:
        events.append(Event(after.tick, "mission", STATION, "all cells are searched", {"cell": "all"}))
    return events
