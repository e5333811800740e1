"""What a node may send: bytes saved for later, a shared channel, and what the medium does with frames beyond."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from medium.airtime import SAVED_TICKS, Airtime
from medium.config import MediumConfig, Radio
from medium.core import Medium
from medium.messages import BROADCAST, UNLIMITED, Frame, Inbox, Transmission
from world.grid import GridGeometry
from world.messages import Positions
from world.terms import TICK_S


def hears_all(n: int) -> NDArray[np.bool_]:
    return ~np.eye(n, dtype=np.bool_)


def medium(**radio: float) -> Medium:
    geometry = GridGeometry(40, 40)
    free = np.zeros((40, 40), np.bool_)
    return Medium(MediumConfig(1, 2, 1, 15.0, geometry, free, Radio(**radio)))  # type: ignore[arg-type]


def step(core: Medium, tick: int, *frames: Frame) -> dict[int, Inbox]:
    """Robot 1 sends; the station and robot 2 hear it."""
    places = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    positions = Positions(tick, np.arange(3, dtype=np.int16), places, (), 0.0)
    return core.step(positions, {k: Transmission(tick, k, frames if k == 1 else ()) for k in range(3)})


def test_a_frame_of_several_ticks_leaves_when_its_bytes_are_saved() -> None:
    core = medium(bandwidth_bytes_s=1000.0)
    long: Frame = (BROADCAST, bytes(350))
    rooms, heard = [], []
    for tick in range(8):
        inboxes = step(core, tick, *([long] if rooms and rooms[-1] >= 350 else []))
        rooms.append(inboxes[1].room_bytes)
        heard.append(len(inboxes[2].receptions))
    assert rooms == [100, 200, 300, 400, 150, 250, 350, 100]
    assert heard == [0, 0, 0, 0, 1, 0, 0, 1]
    assert core.rejected == 0
    assert {inboxes[1].share_bytes for inboxes in [step(core, 8)]} == {100}


def test_bytes_are_saved_for_so_many_ticks_and_no_more() -> None:
    airtime = Airtime(Radio(bandwidth_bytes_s=1000.0))
    for _ in range(50):
        airtime.refill([7], hears_all(1))
    assert airtime.told(7) == (100 * SAVED_TICKS, 100)
    assert not airtime.spend(7, 100 * SAVED_TICKS + 1)
    assert airtime.spend(7, 100 * SAVED_TICKS)
    assert not airtime.spend(7, 1)


def test_what_there_is_no_airtime_for_is_rejected_and_counted_and_what_came_before_is_not() -> None:
    core = medium(bandwidth_bytes_s=1000.0)
    step(core, 0, (BROADCAST, bytes(1)))
    assert core.rejected == 1, "nobody has told the node yet what it may send"
    inboxes = step(core, 1, (2, bytes(60)), (2, bytes(41)), (2, bytes(1)))
    assert [len(payload) for _, _, payload in inboxes[2].receptions] == [60]
    assert (core.sent, core.rejected, core.sent_bytes) == (1, 3, 60)


def test_an_unlimited_radio_says_so_from_the_start() -> None:
    core = medium()
    inboxes = step(core, 0, (BROADCAST, bytes(10**6)))
    assert inboxes[2].receptions
    assert (inboxes[1].room_bytes, inboxes[1].share_bytes) == (UNLIMITED, UNLIMITED)


def test_who_hears_one_another_shares_the_channel() -> None:
    airtime = Airtime(Radio(channel_bytes_s=1200.0))
    # A chain 0 - 1 - 2 - 3, and 4 all alone.
    heard = np.zeros((5, 5), np.bool_)
    for a in range(3):
        heard[a, a + 1] = heard[a + 1, a] = True
    airtime.refill(list(range(5)), heard)
    assert [airtime.told(node)[1] for node in range(5)] == [40, 40, 40, 40, 120]
    capped = Airtime(Radio(channel_bytes_s=1200.0, bandwidth_bytes_s=500.0))
    capped.refill(list(range(5)), heard)
    assert [capped.told(node)[1] for node in range(5)] == [40, 40, 40, 40, 50]


@given(
    st.integers(2, 9).flatmap(lambda n: st.tuples(st.just(n), st.lists(st.booleans(), min_size=n * n, max_size=n * n)))
)
def test_nobody_hears_more_than_the_channel_carries(topology: tuple[int, list[bool]]) -> None:
    n, links = topology
    heard = np.triu(np.array(links).reshape(n, n), 1)
    heard |= heard.T
    airtime = Airtime(Radio(channel_bytes_s=1e6))
    airtime.refill(list(range(n)), heard)
    shares = np.array([airtime.told(node)[1] for node in range(n)])
    assert ((heard | np.eye(n, dtype=np.bool_)) @ shares <= 1e6 * TICK_S + 1e-6).all()
