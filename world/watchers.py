"""What the world tells those who watch a run, outside the lockstep: snapshots in batches, events one by one."""

from __future__ import annotations

from typing import Final

from bus.session import Put, Session
from world.account import Told
from world.feed import Event, Snapshot, pack_feed

__all__ = ["FEED_TICKS", "Watchers"]

FEED_TICKS: Final = 10
"""Snapshots that one message of the feed carries."""


class Watchers:
    """Recorder, launcher and operators, wherever they listen."""

    def __init__(self, session: Session) -> None:
        self._put_feed: Put = session.publisher(session.keys.feed, blocking=False)
        self._put_event: Put = session.publisher(session.keys.event, blocking=False)
        self._batch: list[Snapshot] = []
        self.last: Snapshot | None = None
        """The newest snapshot."""

    def tell(self, told: Told) -> None:
        """Tell what a tick came to: its events now, its snapshot when the batch is full."""
        for event in told.events:
            self.event(event)
        self.last = told.snapshot
        self._batch.append(told.snapshot)
        if len(self._batch) >= FEED_TICKS:
            self.flush()

    def event(self, event: Event) -> None:
        """Tell an event that belongs to no tick's account."""
        self._put_event(event.encode())

    def flush(self) -> None:
        """Send the snapshots of a batch that is not full."""
        if self._batch:
            self._put_feed(pack_feed(self._batch))
            self._batch.clear()
