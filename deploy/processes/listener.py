"""Reads what a run publishes for its launcher: for the run folder, for the view, and for the launcher itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bus.codec import WireError, unpack_map
from bus.keys import Keys
from bus.phases import decode_phases
from bus.session import Mailbox, Session
from deploy.run_folder.writer import RunFolder
from world.feed import Event, Signal, unpack_feed

if TYPE_CHECKING:
    from deploy.screen.view import View

__all__ = ["Listener"]


class Listener:
    """Reads messages in the order in which they come in."""

    def __init__(self, folder: RunFolder, view: View, last_node: int, wake: Callable[[], None]) -> None:
        """Prepare. `listen` begins to receive.

        Args:
            folder: gets snapshots and events.
            view: shows them.
            last_node: the highest node of the run.
            wake: called after each message, by a thread of the bus.
        """
        self._folder = folder
        self._view = view
        self._last_node = last_node
        self._mailbox = Mailbox(wake)
        self.finals: dict[str, dict[str, Any]] = {}
        """Last counts by process (`world`, `medium`, `station`) so far; and `phases`."""

    def listen(self, session: Session) -> None:
        """Subscribe to all that is meant for a launcher."""
        keys = session.keys
        session.subscribe(self._mailbox, keys.feed, keys.event, keys.signal, keys.final("*"))
        session.subscribe(self._mailbox, keys.phases("*"), bounded=True)

    def take(self) -> list[Signal]:
        """Read the messages that have come in; returns the signals that the world orders."""
        orders: list[Signal] = []
        for key, payload in self._mailbox.waiting():
            kind, process = Keys.kind_of(key)
            try:
                self._receive(kind, process, payload or b"", orders)
            except WireError as error:
                self._view.line(f"dropped a malformed {kind}: {error}")
        return orders

    def _receive(self, kind: str, process: str, payload: bytes, orders: list[Signal]) -> None:
        if kind == "feed":
            for snapshot in unpack_feed(payload):
                self._folder.snapshot(snapshot)
                self._view.snapshot(snapshot)
        elif kind == "event":
            event = Event.decode(payload)
            self._folder.event(event)
            self._view.event(event)
        elif kind == "signal":
            order = Signal.decode(payload)
            if order.node > self._last_node:
                raise WireError("a signal for a node that there is not")
            orders.append(order)
        elif kind == "phases":
            phases = self.finals.setdefault("phases", {})
            phases[process] = decode_phases(payload)
            self._view.phases(phases)
        elif kind == "final":
            self.finals[process] = unpack_map(payload)
