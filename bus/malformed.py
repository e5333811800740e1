"""The count of malformed messages: they are data, not exceptions of ours (ARCHITECTURE.md, invariant 5)."""

from __future__ import annotations

import logging

from bus.codec import WireError
from bus.excerpt import shown

__all__ = ["Malformed"]

log = logging.getLogger(__name__)


class Malformed:
    """Counts the malformed messages that one process dropped, and logs the first one."""

    def __init__(self) -> None:
        self.count = 0

    def drop(self, what: str, error: WireError) -> None:
        """Drop a message; `what` says which, such as "message on KEY"."""
        self.count += 1
        if self.count == 1:
            log.warning("dropped a malformed %s: %s (further ones are only counted)", shown(what), error)
