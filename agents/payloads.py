"""What a node does with the payloads that it hears, by their kind: robots and the MS alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from agents.messages import UPDATE, kind_of
from bus.codec import WireError
from medium.messages import Inbox, Reception


def sort_payloads(
    inbox: Inbox | None, handlers: Mapping[int, Callable[[bytes], object]]
) -> tuple[list[Reception], int]:
    """Hand each payload to the handler of its kind, in order of arrival; routing updates are for everyone.

    Args:
        inbox: what was heard; None at the first tick after (re)joining.
        handlers: by kind; they raise `WireError` for what is malformed.

    Returns:
        The routing updates, and how many payloads were malformed or of a kind without a handler.
    """
    updates: list[Reception] = []
    bad = 0
    if inbox is None:
        return updates, bad
    for reception in inbox.receptions:
        payload = reception[2]
        try:
            kind = kind_of(payload)
            if kind == UPDATE:
                updates.append(reception)
            elif kind in handlers:
                handlers[kind](payload)
            else:
                bad += 1
        except WireError:
            bad += 1
    return updates, bad
