"""Who hears which frame, what is lost on the way, and what the trace digest covers [paper 9.1]."""

from __future__ import annotations

import hashlib
import struct

import numpy as np
import pytest

from medium.config import MediumConfig, Radio
from medium.core import Medium
from medium.messages import BROADCAST, Frame, Inbox, Transmission
from world.grid import GridGeometry
from world.messages import Jam, Positions

NODES = np.arange(4, dtype=np.int16)
PLACES = np.array([[1.0, 1.0], [9.0, 1.0], [17.0, 1.0], [17.0, 9.0]])
"""r_t is 10 m: a row in which each hears the next."""


def medium(**radio: float) -> Medium:
    geometry = GridGeometry(40, 40)
    free = np.zeros((40, 40), np.bool_)
    return Medium(MediumConfig(1, 3, 1, 10.0, geometry, free, Radio(**radio)))  # type: ignore[arg-type]


def carry(
    core: Medium,
    frames: dict[int, tuple[Frame, ...]],
    *,
    gone: tuple[int, ...] = (),
    jams: tuple[Jam, ...] = (),
    loss: float = 0.0,
    tick: int = 7,
) -> dict[int, Inbox]:
    """The inboxes after a tick in which all transmit but those that are gone."""
    positions = Positions(tick, NODES, PLACES, jams, loss)
    sent = {k: Transmission(tick, k, frames.get(k, ())) for k in NODES.tolist() if k not in gone}
    return core.step(positions, sent)


def heard(inboxes: dict[int, Inbox]) -> dict[int, list[tuple[int, bytes]]]:
    """By node: sources and payloads, in the order of the inbox."""
    return {node: [(src, payload) for src, _, payload in inbox.receptions] for node, inbox in inboxes.items()}


ALL = {k: ((BROADCAST, bytes([k])),) for k in range(4)}


def test_everybody_within_the_radius_hears_a_broadcast_in_the_order_of_sources() -> None:
    core = medium()
    inboxes = carry(core, ALL)
    assert heard(inboxes) == {
        0: [(1, b"\1")],
        1: [(0, b"\0"), (2, b"\2")],
        2: [(1, b"\1"), (3, b"\3")],
        3: [(2, b"\2")],
    }
    assert {inbox.tick for inbox in inboxes.values()} == {8}
    assert [level for _, level, _ in inboxes[1].receptions] == pytest.approx([-40.0 - 30.0 * np.log10(8.0)] * 2)


def test_a_frame_for_one_node_is_heard_by_that_one_alone_if_it_is_near() -> None:
    inboxes = carry(medium(), {1: ((2, b"near"), (3, b"far"), (2, b"again"))})
    assert heard(inboxes) == {0: [], 1: [], 2: [(1, b"near"), (1, b"again")], 3: []}


def test_who_is_gone_says_nothing_hears_nothing_and_has_no_inbox() -> None:
    assert heard(carry(medium(), ALL, gone=(1,))) == {0: [], 2: [(3, b"\3")], 3: [(2, b"\2")]}


def test_counts_are_of_frames_sent_and_of_receptions() -> None:
    core = medium()
    carry(core, ALL)
    carry(core, {1: ((BROADCAST, b"four"), (3, b"far"))}, tick=8)
    assert core.final()["frames"] == {"sent": 6, "delivered": 8, "rejected": 0, "bytes": 11}


def test_nodes_in_a_jammed_region_hear_nothing_and_are_heard() -> None:
    # Node 1 lies on the west rim of the region and node 2 on its east rim.
    for region_m in ((9.0, 0.0, 17.0, 2.0), (8.0, 1.0, 18.0, 5.0), (8.0, -3.0, 18.0, 1.0)):
        inboxes = carry(medium(), ALL, jams=(Jam(region_m=region_m),))
        assert heard(inboxes) == {0: [(1, b"\1")], 1: [], 2: [], 3: [(2, b"\2")]}
    for region_m in ((9.1, 0.0, 16.9, 2.0), (8.0, 1.1, 18.0, 5.0), (8.0, -3.0, 18.0, 0.9)):
        assert heard(carry(medium(), ALL, jams=(Jam(region_m=region_m),))) == heard(carry(medium(), ALL))


def test_a_jammed_pair_does_not_hear_each_other() -> None:
    inboxes = carry(medium(), ALL, jams=(Jam(pair=(2, 1)),))
    assert heard(inboxes) == {0: [(1, b"\1")], 1: [(0, b"\0")], 2: [(3, b"\3")], 3: [(2, b"\2")]}


def share_heard(fault: float, **radio: float) -> float:
    """Of 2,000 frames over one link."""
    core = medium(**radio)
    for tick in range(2000):
        carry(core, {0: ((1, b"x"),)}, loss=fault, tick=tick)
    return core.delivered / core.sent


def test_losses_of_the_radio_of_a_fault_and_of_bursts_are_independent() -> None:
    assert share_heard(0.0) == 1.0
    assert share_heard(1.0) == 0.0
    assert share_heard(0.0, loss=0.3) == pytest.approx(0.7, abs=0.04)
    assert share_heard(0.4, loss=0.3) == pytest.approx(0.42, abs=0.04)
    assert share_heard(0.0, burst_share=0.5, burst_loss=1.0) == pytest.approx(0.5, abs=0.08)
    assert share_heard(0.0, burst_share=0.5, burst_loss=0.2) == pytest.approx(0.9, abs=0.04)


def test_without_loss_no_random_number_is_drawn() -> None:
    """So a fault that begins later meets the same numbers, whatever was sent before it."""
    quiet, busy = medium(), medium()
    carry(busy, ALL)
    later = [heard(carry(core, ALL, loss=0.5, tick=tick)) for core in (quiet, busy) for tick in (8, 9, 10)]
    assert later[:3] == later[3:]


def test_the_digest_covers_places_and_frames_of_those_whose_transmission_counted() -> None:
    core = medium()
    carry(core, {1: ((BROADCAST, b"abc"), (2, b"d"))})
    carry(core, ALL, gone=(1,), tick=8)
    digest = hashlib.sha256()
    digest.update(struct.pack("<IH", 7, 4) + NODES.tobytes() + PLACES.tobytes())
    digest.update(struct.pack("<HiI", 1, BROADCAST, 3) + b"abc" + struct.pack("<HiI", 1, 2, 1) + b"d")
    counted = [0, 2, 3]
    digest.update(struct.pack("<IH", 8, 3) + NODES[counted].tobytes() + PLACES[counted].tobytes())
    for node in counted:
        digest.update(struct.pack("<HiI", node, BROADCAST, 1) + bytes([node]))
    assert core.final()["trace_sha256"] == digest.hexdigest()
