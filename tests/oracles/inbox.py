"""An inbox, reception by reception: the oracle of medium/_receptions.pyx."""

from __future__ import annotations

import math
import struct

from bus.codec import WireError
from medium.messages import Inbox, Reception
from world.terms import MAX_NODE

_HEAD = struct.Struct("<III")
_HEARD = struct.Struct("<HdI")
_BAD_INBOX = "an inbox is a run of (node, finite power, payload)"


def encode(inbox: Inbox) -> bytes:
    """As medium.messages.Inbox.encode."""
    parts = [_HEAD.pack(inbox.tick, inbox.room_bytes, inbox.share_bytes)]
    for src, power, payload in inbox.receptions:
        parts += (_HEARD.pack(src, power, len(payload)), payload)
    return b"".join(parts)


def decode(data: bytes) -> Inbox:
    """As medium.messages.Inbox.decode, of data that has a head."""
    heard: list[Reception] = []
    at = _HEAD.size
    while at < len(data):
        if at + _HEARD.size > len(data):
            raise WireError(_BAD_INBOX)
        src, power, length = _HEARD.unpack_from(data, at)
        at += _HEARD.size
        if at + length > len(data) or src > MAX_NODE or not math.isfinite(power):
            raise WireError(_BAD_INBOX)
        heard.append((src, power, data[at : at + length]))
        at += length
    tick, room_bytes, share_bytes = _HEAD.unpack_from(data)
    return Inbox(tick, tuple(heard), room_bytes, share_bytes)
