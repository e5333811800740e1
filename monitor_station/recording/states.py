"""The state of each robot, in one word."""

from __future__ import annotations

from collections.abc import Collection
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from world.feed import Event, Snapshot
from world.terms import Mode


class State(IntEnum):
    """States as recording and terminal show them."""

    SEARCH = 0
    RELAY = 1
    RECOVERING = 2
    AWAY = 3
    """On a sortie: a planned absence."""
    LOST = 4
    PAUSED = 5
    DEAD = 6


# Plain numbers, since each access to a member of an enumeration is a look-up by name.
_SEARCH: Final = int(State.SEARCH)
_RELAY: Final = int(State.RELAY)
_RECOVERING: Final = int(State.RECOVERING)
_AWAY: Final = int(State.AWAY)
_LOST: Final = int(State.LOST)
_PAUSED: Final = int(State.PAUSED)
_DEAD: Final = int(State.DEAD)
_OF_MODE: Final = {
    int(Mode.INNER): _RECOVERING,
    int(Mode.OUTER): _RECOVERING,
    int(Mode.AWAY): _AWAY,
    int(Mode.LOST): _LOST,
}


def states_of(snapshot: Snapshot, paused: Collection[int]) -> NDArray[np.int64]:
    """`State` of each robot, shape (n,); one that takes no part is dead unless it is known to be `paused`."""
    states: list[int] = []
    rows = zip(
        snapshot.nodes.tolist(), snapshot.present.tolist(), snapshot.cls.tolist(), snapshot.mode.tolist(), strict=True
    )
    for node, present, cls, mode in rows:
        if not present:
            states.append(_PAUSED if node in paused else _DEAD)
        else:
            states.append(_OF_MODE.get(mode, _RELAY if cls else _SEARCH))
    return np.array(states, np.int64)


class SteadyStates:
    """Settles states: a relay that corrects its distance for a tick or two is still shown as a relay.

    A change among search, relay and recovering shows after `dwell_ticks`; away, lost, paused and dead show at once.
    """

    def __init__(self, robots: int, dwell_ticks: int = 10) -> None:
        self._dwell_ticks = dwell_ticks
        self._shown = np.full(robots, -1)
        self._latest = np.full(robots, -1)
        self._since = np.zeros(robots, np.int64)
        self._settled: bytes | None = None
        """Bytes of the shown states if no change waits; else None."""

    @property
    def settled(self) -> bool:
        """Whether no change waits to be shown."""
        return self._settled is not None

    def update(self, tick: int, states: NDArray[np.int64]) -> NDArray[np.int64]:
        """States to show at a tick, shape (n,)."""
        key = states.tobytes()
        if key == self._settled:
            return self._shown
        self._since[states != self._latest] = tick
        self._latest = states
        urgent = (states >= _AWAY) | (self._shown >= _AWAY) | (self._shown < 0)
        lasting = tick - self._since >= self._dwell_ticks
        self._shown = np.where(urgent | lasting, states, self._shown)
        self._settled = key if self._shown.tobytes() == key else None
        return self._shown


class DisplayedStates:
    """The state of each robot for recording and terminal: as the world sees it, settled by `SteadyStates`."""

    def __init__(self) -> None:
        self._paused: set[int] = set()
        """Robots that take no part, but are expected back."""
        self._steady: SteadyStates | None = None

    def hear(self, event: Event) -> bool:
        """Learn from an event who is paused; False if it is no event of that kind."""
        if event.kind != "fault":
            return False
        if event.data.get("verb") == "pause" or event.data.get("cause") == "unresponsive":
            self._paused.add(event.node)
        else:
            self._paused.discard(event.node)
        return True

    def update(self, snapshot: Snapshot) -> NDArray[np.int64]:
        """`State` of each robot to show at a tick, shape (n,)."""
        if self._steady is None:
            self._steady = SteadyStates(len(snapshot.nodes))
        return self._steady.update(snapshot.tick, states_of(snapshot, self._paused))

    @property
    def settled(self) -> bool:
        """Whether no change waits to be shown."""
        return self._steady is not None and self._steady.settled
