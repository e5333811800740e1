"""DSDV and the sticky route to the MS on random moving topologies [paper 2.6 to 3.6]."""

from __future__ import annotations

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.dsdv import Router
from agents.forwarding_table import freshness_of
from agents.link_quality import LinkQuality
from agents.messages import Update
from tests.helpers.routing_field import Entries, Field, power_dbm, router_config, stale_hops
from world.terms import NOBODY, STATION, UNREACHABLE, Cls

SETTLED_TICKS = 45
"""Time-out, probing, and as many ticks as a change needs to cross the network and back."""


@settings(max_examples=50, deadline=None)
@given(
    nodes=st.integers(3, 9),
    seed=st.integers(0, 2**32),
    loss=st.sampled_from([0.0, 0.1, 0.3]),
    step_m=st.sampled_from([0.3, 1.0, 3.0]),
    faults=st.sampled_from([0.03, 0.2]),
)
# When robot 5 is back from a pause, and before its first tick, its table points to 1, a new incarnation that has just
# learned a route through 5.
@example(nodes=6, seed=209, loss=0.0, step_m=3.0, faults=0.03)
def test_no_loop_at_any_tick_and_freshness_never_falls(
    nodes: int, seed: int, loss: float, step_m: float, faults: float
) -> None:
    rng = random.Random(seed)
    field = Field(nodes, rng, loss=loss)
    before: Entries = {}
    newest: Entries = {}
    for _ in range(150):
        if rng.random() < faults:
            newcomer = rng.randrange(nodes)
            field.restart(newcomer)
            newest.pop(newcomer, None)
        if rng.random() < faults:
            field.pause(rng.randrange(nodes), rng.randint(1, 30))
        field.move(step_m)
        field.step()
        assert field.loops() == []
        now = field.entries()
        assert stale_hops(before, now) == []
        for node, table in now.items():
            old = newest.get(node, {})
            assert all(table[dst][0] >= freshness for dst, (freshness, _) in old.items()), f"{node}: an older entry"
        newest |= now
        before = now


@settings(max_examples=40, deadline=None)
@given(nodes=st.integers(3, 10), seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.3]))
def test_tables_hold_true_hop_counts_once_the_topology_rests(nodes: int, seed: int, loss: float) -> None:
    rng = random.Random(seed)
    field = Field(nodes, rng, loss=loss)
    for _ in range(60):
        if rng.random() < 0.05:
            field.restart(rng.randrange(nodes))
        field.move(2.0)
        field.step()
    field.loss = 0.0
    for _ in range(SETTLED_TICKS):
        field.step()
    for node in field.routers:
        truth = field.true_hops(node)
        for dst in field.routers:
            if dst == STATION and node != STATION:
                path = field.path_to_ms(node)
                assert (path is not None) == (dst in truth)
            elif dst != node:
                assert field.hop(node, dst) == truth.get(dst, UNREACHABLE)


def chain(places: dict[int, tuple[float, float]]) -> Field:
    field = Field(len(places), random.Random(1), side_m=1000.0)
    field.places = places
    return field


def test_a_partition_withdraws_its_routes_and_they_come_back() -> None:
    field = chain({0: (0.0, 0.0), 1: (7.0, 0.0), 2: (14.0, 0.0), 3: (21.0, 0.0)})
    for _ in range(20):
        field.step()
    assert field.path_to_ms(3) == [3, 2, 1, 0]
    field.places[1] = (7.0, 500.0)
    for _ in range(20):
        field.step()
    assert [field.hop(k, STATION) for k in (1, 2, 3)] == [UNREACHABLE] * 3
    assert field.hop(3, 2) == 1
    assert field.hop(3, 1) == UNREACHABLE
    field.places[1] = (7.0, 0.0)
    for _ in range(20):
        field.step()
    assert field.path_to_ms(3) == [3, 2, 1, 0]
    assert field.hop(0, 3) == 3


def test_a_neighbor_is_gone_after_ten_silent_ticks_and_its_number_is_odd() -> None:
    field = chain({0: (0.0, 0.0), 1: (7.0, 0.0)})
    for _ in range(5):
        field.step()
    last_heard = field.tick  # the frame sent at the tick before
    field.pause(0, 100)
    while field.tick < last_heard + 10:
        field.step()
        assert field.hop(1, STATION) == 1
    field.step()
    table = field.routers[1].table
    assert table.hop(STATION) == UNREACHABLE
    assert table.freshness(STATION) >> 8 & 1 == 1
    assert field.next_hop(1, STATION) == NOBODY


def test_a_new_incarnation_is_silent_for_the_timeout_and_one_tick() -> None:
    field = chain({0: (0.0, 0.0), 1: (7.0, 0.0)})
    for _ in range(5):
        field.step()
    field.restart(1)
    born = field.tick
    while field.tick <= born + 12:
        field.step()
        if field.tick <= born + 11:
            assert field.hop(1, STATION) == UNREACHABLE
    assert field.hop(1, STATION) == 1


def test_who_comes_back_gives_up_a_restarted_next_hop_before_it_sends() -> None:
    """Until its first tick the table of 2 leads to 1, that of 1 to 3, and that of 3 to 2; no frame takes that way."""
    field = chain({0: (0.0, 0.0), 1: (7.0, 0.0), 2: (14.0, 0.0), 3: (17.5, 6.0)})
    for _ in range(20):
        field.step()
    assert field.path_to_ms(3) == [3, 2, 1, 0]
    field.restart(1)
    field.places |= {0: (0.0, 500.0), 3: (10.5, 6.0)}
    for _ in range(2):
        field.step()
    field.pause(2, 10)
    for _ in range(10):
        field.step()
    assert 2 in field.present
    assert [field.next_hop(node, STATION) for node in (2, 1, 3)] == [1, 3, 2]
    assert field.loops() == []
    before = field.entries()
    field.step()
    assert [field.next_hop(node, STATION) for node in (2, 1, 3)] == [NOBODY, 3, NOBODY]
    assert stale_hops(before, field.entries()) == []


def update_of(router: Router, nms: int) -> bytes:
    return Update(nms, NOBODY, 0, router.table.advertised(), b"").encode()


class TowardsNode2(LinkQuality):
    """The links of a robot that is about to walk to where it hears only node 2."""

    def leaving(self) -> bool:
        return True

    def lasting(self, node: int) -> bool:
        return node == 2


def test_who_leaves_its_nms_for_a_neighbor_is_not_led_straight_back_by_the_shorter_way() -> None:
    """Three at the end of a chain: 3 can't take 1 along to where it wants to go, but 2 beside it."""
    field = Field(4, random.Random(5))
    field.places = {0: (0.0, 0.0), 1: (9.0, 0.0), 2: (14.0, 0.0), 3: (14.0, 0.5)}
    for _ in range(20):
        field.step()
    assert field.path_to_ms(3) == [3, 1, 0]
    ms = field.routers[3].ms
    by_power, ms.links = ms.links, TowardsNode2(ms.links.neighbors, ms.r_in_m)
    seen = []
    for _ in range(60):
        field.step()
        seen.append(field.next_hop(3, STATION))
    changed = seen.index(2)
    assert set(seen[changed:]) == {2}
    assert field.path_to_ms(3) == [3, 2, 1, 0]
    ms.links = by_power
    field.step()
    assert field.path_to_ms(3) == [3, 1, 0], "and by rule c when nothing keeps it from there"


def test_equal_hop_counts_do_not_flap() -> None:
    """Two neighbors offer the same route: the first that was taken stays."""
    rng = random.Random(0)
    me = Router(router_config(1), rng, 0)
    for tick in range(5, 24):
        offers = []
        for neighbor in (2, 3):
            other = Router(router_config(neighbor), rng, 0)
            other.announce_self(tick - 1, (0.0, 5.0), Cls.SR, (0.0, 0.0))
            other.table.set_route(7, freshness_of(2 * (tick - 4), 3), 9)
            other.table.set_inherent(7, Cls.SR, (1.0, 1.0), (1.0, 1.0))
            offers.append((neighbor, power_dbm(5.0), update_of(other, NOBODY)))
        # Node 3 alone at first, then 2 as well, whose id is lower.
        me.step(tick, offers[1:] if tick < 9 else offers)
        assert me.table.next_hop_to(7) == 3


FRESH = (2 * 256 + 255).to_bytes(8, "little")


@pytest.mark.parametrize(
    "spoil",
    [
        lambda raw: raw[:-1],
        lambda raw: raw + b"\x00",
        lambda _: b"",
        lambda _: b"\x91\x01",
        lambda raw: raw.replace(FRESH, FRESH[:-1]),
        lambda raw: raw.replace(FRESH, (2 * 256).to_bytes(8, "little")),
        lambda raw: raw.replace(FRESH, (3 * 256 + 255).to_bytes(8, "little")),
    ],
)
def test_a_malformed_update_is_counted_and_the_others_still_count(spoil) -> None:  # type: ignore[no-untyped-def]
    rng = random.Random(0)
    good, bad, me = (Router(router_config(k), rng, 0) for k in (2, 3, 1))
    for router in (good, bad):
        router.announce_self(1, (0.0, 0.0), Cls.SR, (0.0, 0.0))
    raw = update_of(bad, NOBODY)
    assert spoil(raw) != raw
    heard = [(2, -50.0, update_of(good, NOBODY)), (3, -50.0, spoil(raw))]
    me.step(2, heard)
    assert me.bad_frames == 1
    assert sorted(me.neighbors.by_id) == [2]
    assert me.table.hop(2) == 1
