"""The routing update of each tick, built to the room that the radio has [paper 2.5].

With an unlimited radio it is the whole table and all acknowledgements. Otherwise routing comes first, in half of what
a tick adds or of what the radio takes: this node's own row and that of the MS, and as many others as there is room
for, in turn (the incremental update of Perkins & Bhagwat). Then come acknowledgements, in an eighth.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from agents.dsdv import Router
from agents.forwarding_table import ROW
from agents.messages import Update
from agents.room import Room
from world.terms import STATION

Acks: TypeAlias = tuple[bytes, int, bytes]
"""Acknowledgements: a sequence of ACK, the version of the map with these reports, and a sequence of AHEAD."""

_HEAD_BYTES: Final = 36
"""Most that an update takes beside its columns."""
_ROUTING_SHARE: Final = 0.5
_ACKS_SHARE: Final = 0.125
_ACKS_AGAIN_TICKS: Final = 10
"""Acknowledgements that have not changed are said again after this long, since a frame may be lost."""


class Announcer:
    """Makes the updates of one node."""

    def __init__(self, router: Router) -> None:
        self._router = router
        self._longest_wait = router.config.rules.routing.silence_ticks - 1
        self._next_tick = 0
        self._turn = 0
        """How many rows of others were sent; the next one is due."""
        self._acks = b"", b""
        """Sequences of ACK and of AHEAD that were said last."""
        self._acks_tick = 0
        """When they may change."""
        self._same_tick = 0
        """When they are said again."""

    def update(self, tick: int, nms: int, hold: int, map_version: int, acks: Acks, room: Room) -> bytes | None:
        """The update of this tick; None if the radio has no room for one, or should not have one so soon."""
        table = self._router.table
        if not room.limited:
            return Update(nms, hold, map_version, table.advertised(), *acks).encode()
        first = [dst for dst in (self._router.node, STATION) if table.freshness(dst) >= 0]
        least = _HEAD_BYTES + ROW.size * len(first)
        if tick < self._next_tick or room.left < least:
            return None
        wait = min(max(math.ceil(least / max(_ROUTING_SHARE * room.share, 1.0)), 1), self._longest_wait)
        self._next_tick = tick + wait
        most = min(max(_ROUTING_SHARE * room.share * wait, room.left / 2), room.left)
        rows = table.advertised(first + self._in_turn(first, int(most - least) // ROW.size))
        said = self._acks_due(tick, acks, room, _HEAD_BYTES + len(rows))
        payload = Update(nms, hold, map_version, rows, *said).encode()
        room.take(len(payload))
        return payload

    def _in_turn(self, first: list[int], most: int) -> list[int]:
        """Up to `most` other destinations, those that were sent least lately."""
        others = [dst for dst in self._router.table.known if dst not in first]
        if len(others) > most:
            at = self._turn % len(others)
            others = (others[at:] + others[:at])[: max(most, 0)]
        self._turn += len(others)
        return others

    def _acks_due(self, tick: int, acks: Acks, room: Room, used: int) -> Acks:
        """The acknowledgements, if they fit and are worth their bytes now; else none."""
        sequences = acks[0], acks[2]
        size = sum(map(len, sequences))
        if tick < (self._same_tick if sequences == self._acks else self._acks_tick) or used + size > room.left:
            return b"", 0, b""
        wait = math.ceil(size / max(_ACKS_SHARE * room.share, 1.0))
        self._acks, self._acks_tick, self._same_tick = sequences, tick + wait, tick + max(wait, _ACKS_AGAIN_TICKS)
        return acks
