"""What a node's radio takes in one tick, and what is left of it while the node fills it: routing first, then
acknowledgements, then scan reports, then the map.
"""

from __future__ import annotations

from medium.messages import UNLIMITED, Inbox


class Room:
    """The bytes of one tick."""

    def __init__(self, inbox: Inbox | None, *, limited: bool) -> None:
        """Without an inbox, at the first tick after (re)joining, a node with a limited radio does not know its room."""
        self.limited = limited
        self.left = 0
        """Bytes that may still be sent in this tick."""
        self.share = 0
        """Bytes that each tick adds."""
        if inbox is not None:
            self.left, self.share = inbox.room_bytes, inbox.share_bytes
        elif not limited:
            self.left = self.share = UNLIMITED

    def take(self, size: int) -> bool:
        """Whether a payload of that size fits; if so, its bytes are used up."""
        if size > self.left:
            return False
        self.left -= size
        return True
