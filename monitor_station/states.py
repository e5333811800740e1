"""What each robot does, in one word."""

from __future__ import annotations

from collections.abc import Collection
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from world.messages import Cls, Mode, Snapshot


class State(IntEnum):
    """What `network/state/<robot>` shows."""

    SEARCH = 0
    RELAY = 1
    RECOVERING = 2
    LOST = 3
    PAUSED = 4
    DEAD = 5


def states_of(snapshot: Snapshot, paused: Collection[int]) -> NDArray[np.int64]:
    """`State` of each robot, shape (n,); whoever takes no part is dead unless it is known to be `paused`."""
    mode = snapshot.mode
    states = np.where(snapshot.cls == Cls.RR, int(State.RELAY), int(State.SEARCH))
    states[(mode == Mode.INNER) | (mode == Mode.OUTER)] = State.RECOVERING
    states[mode == Mode.LOST] = State.LOST
    for row in np.flatnonzero(snapshot.present == 0):
        states[row] = State.PAUSED if int(snapshot.nodes[row]) in paused else State.DEAD
    return states


class SteadyStates:
    """States as a reader wants them: a relay that corrects its distance for a tick or two is still a relay.

    A change among search, relay and recovering shows once it has lasted; lost, paused and dead show at once.
    """

    def __init__(self, robots: int, dwell_ticks: int = 10) -> None:
        self._dwell_ticks = dwell_ticks
        self._shown = np.full(robots, -1)
        self._latest = np.full(robots, -1)
        self._since = np.zeros(robots, np.int64)

    def update(self, tick: int, states: NDArray[np.int64]) -> NDArray[np.int64]:
        """States to show at a tick, shape (n,)."""
        self._since[states != self._latest] = tick
        self._latest = states
        urgent = (states >= State.LOST) | (self._shown >= State.LOST) | (self._shown < 0)
        lasting = tick - self._since >= self._dwell_ticks
        self._shown = np.where(urgent | lasting, states, self._shown)
        return self._shown
