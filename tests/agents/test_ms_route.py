"""The three rules by which a robot changes its NMS, one neighbor more or less at a time [paper 3.2 to 3.5, 3.7]."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterator

import pytest

from agents.config import Routing, Rules
from agents.forwarding_table import ForwardingTable, freshness_of
from agents.neighbors import Neighbors
from agents.nms import MsRoute
from tests.helpers.routing_field import power_dbm, router_config
from world.terms import NOBODY, STATION, UNREACHABLE

ME = 1
R_IN_M = 8.0
"""r_t is 10 m: rule b takes neighbors within 7.2 m, rule c within 6.5 m."""


class Chance(random.Random):
    """Gives the numbers that it was told to give."""

    def __init__(self, *numbers: float) -> None:
        super().__init__(0)
        self._numbers: Iterator[float] = iter(numbers)

    def random(self) -> float:
        """The next number."""
        return next(self._numbers)


class Route:
    """Robot 1's entry for the MS, among neighbors that say what a test has them say."""

    def __init__(self, *, hops: int = UNREACHABLE, nms: int = NOBODY, seqno: int = 100, **rules: float) -> None:
        config = router_config(ME)
        routing = dataclasses.replace(Routing(), **rules)
        config = dataclasses.replace(config, rules=dataclasses.replace(Rules(), routing=routing))
        self.table = ForwardingTable(ME)
        self.neighbors = Neighbors(config)
        self.route = MsRoute(config, self.table, self.neighbors)
        self.tick = 0
        self.table.set_route(STATION, freshness_of(seqno, hops), nms)

    def hear(self, node: int, distance_m: float, hops: int, seqno: int = 102, nms: int = 7, tick: int = 0) -> None:
        """What a neighbor says of its own entry for the MS."""
        neighbor = self.neighbors.hear(node, tick or self.tick, power_dbm(distance_m))
        neighbor.ms_freshness, neighbor.nms = freshness_of(seqno, hops), nms

    def step(self, *chances: float) -> tuple[int, int, int]:
        """NMS, hop count and sequence number after a tick; it draws all of the numbers, and no other."""
        rng = Chance(*chances)
        self.route.step(self.tick, rng)
        with pytest.raises(StopIteration):
            rng.random()
        self.tick += 1
        return self.route.nms, self.route.hops, self.table.freshness(STATION) >> 8


# -- rule a: no route --------------------------------------------------------------------------------------------------


def test_a_without_a_route_those_within_r_in_come_first() -> None:
    route = Route()
    route.hear(2, 8.1, hops=0)
    route.hear(3, 7.9, hops=5)
    assert route.step() == (3, 6, 102)


def test_a_then_the_one_with_the_fewest_hops() -> None:
    route = Route()
    route.hear(2, 6.8, hops=5)
    route.hear(3, 7.9, hops=4)
    assert route.step() == (3, 5, 102)


def test_a_then_the_nearest() -> None:
    route = Route()
    route.hear(2, 7.9, hops=4)
    route.hear(3, 7.8, hops=4)
    assert route.step() == (3, 5, 102)


def test_a_of_two_that_are_alike_the_one_with_the_lower_id_whoever_was_heard_first() -> None:
    route = Route()
    route.hear(4, 7.9, hops=4)
    route.hear(3, 7.9, hops=4)
    assert route.step()[0] == 3


def test_a_beyond_r_in_the_fewest_hops_count_too() -> None:
    route = Route()
    route.hear(2, 8.5, hops=5)
    route.hear(3, 9.5, hops=4)
    assert route.step()[0] == 3


@pytest.mark.parametrize(
    ("offer", "adopted"),
    [
        ({}, True),
        ({"seqno": 101}, True),
        ({"seqno": 100}, False),
        ({"hops": UNREACHABLE}, False),
        ({"hops": UNREACHABLE - 1}, False),
        ({"hops": UNREACHABLE - 2}, True),
        ({"nms": ME}, False),
    ],
)
def test_a_takes_a_finite_route_with_a_newer_number_by_way_of_another(offer: dict[str, int], adopted: bool) -> None:
    route = Route()
    route.hear(2, 5.0, **{"hops": 3, **offer})
    assert route.step()[0] == (2 if adopted else NOBODY)


@pytest.mark.parametrize(("heard", "adopted"), [(5, False), (6, True)])
def test_a_takes_nobody_who_is_silent(heard: int, adopted: bool) -> None:
    route = Route()
    route.tick = 10
    route.hear(2, 5.0, hops=3, tick=heard)
    assert route.step()[0] == (2 if adopted else NOBODY)


# -- the entry is sticky, and rule b: weak link ------------------------------------------------------------------------


def test_only_the_nms_refreshes_the_entry() -> None:
    route = Route(hops=4, nms=2)
    route.hear(2, 7.9, hops=3, seqno=102)
    route.hear(3, 7.9, hops=2, seqno=110)
    assert route.step() == (2, 4, 102)
    route.hear(2, 7.9, hops=5, seqno=104)
    assert route.step() == (2, 6, 104)
    route.hear(2, 7.9, hops=1, seqno=104)
    assert route.step() == (2, 6, 104), "a newer number only"


def test_an_nms_that_lost_its_route_takes_it_from_this_robot_too() -> None:
    route = Route(hops=4, nms=2)
    route.hear(2, 5.0, hops=UNREACHABLE, seqno=103)
    assert route.step() == (NOBODY, UNREACHABLE, 103)


def weak(*, d_in_m: float = 8.1, **rules: float) -> Route:
    """A robot four hops away, whose NMS 2 is weak, and says nothing new."""
    route = Route(hops=4, nms=2, **rules)
    route.hear(2, d_in_m, hops=3, seqno=100)
    return route


def test_b_adopts_a_potential_nms_whose_number_is_newer_than_the_frozen_one() -> None:
    route = weak()
    route.hear(3, 7.1, hops=3, seqno=101)
    assert route.step(0.49) == (3, 4, 101)


@pytest.mark.parametrize(
    ("offer", "draws"),
    [
        ({"distance_m": 7.3}, False),
        ({"hops": 6}, False),
        ({"hops": UNREACHABLE}, False),
        ({"nms": ME}, False),
        ({"seqno": 100}, True),
    ],
)
def test_b_adopts_no_other(offer: dict[str, float], draws: bool) -> None:
    route = weak()
    route.hear(3, **{"distance_m": 7.1, "hops": 5, "seqno": 101, **offer})  # type: ignore[arg-type]
    assert route.step(*[0.49] * draws)[0] == 2


def test_b_takes_one_hop_more() -> None:
    route = weak()
    route.hear(3, 7.1, hops=5, seqno=101)
    assert route.step(0.49) == (3, 6, 101)


def test_b_takes_of_several_the_one_with_the_fewest_hops_then_the_nearest() -> None:
    route = weak()
    route.hear(3, 6.8, hops=4, seqno=101)
    route.hear(4, 7.1, hops=3, seqno=101)
    assert route.step(0.0)[0] == 4
    route = weak()
    route.hear(3, 7.1, hops=3, seqno=101)
    route.hear(4, 7.0, hops=3, seqno=101)
    assert route.step(0.0)[0] == 4


def test_b_is_for_weak_links_alone() -> None:
    route = weak(d_in_m=7.9)
    route.hear(3, 7.1, hops=3, seqno=101)
    assert route.step()[0] == 2


def test_b_takes_a_silent_nms_for_weak() -> None:
    route = weak(d_in_m=5.0)
    for tick in range(5):
        route.hear(3, 7.1, hops=3, seqno=101)
        assert route.step() == (2, 4, 100), tick
    route.hear(3, 7.1, hops=3, seqno=101)
    assert route.step(0.0)[0] == 3


def test_b_freezes_for_five_ticks_with_probability_one_half_and_not_again_meanwhile() -> None:
    route = weak()
    seqno = 100
    seen = []
    # Chance is asked while the entry is not frozen: in the first tick in vain, in the second with success, and
    # again when the five ticks are over.
    for chances in [(0.5,), (0.49,), (), (), (), (), (), (0.9,), (0.9,)]:
        seqno += 2
        route.hear(2, 8.1, hops=3, seqno=seqno)
        route.hear(3, 7.1, hops=3, seqno=90)
        seen.append(route.step(*chances)[2])
    # The number that the NMS says at each tick is 102, 104, and so on; it is taken before chance is asked.
    assert seen == [102, 104, 104, 104, 104, 104, 104, 116, 118]


def test_b_hears_of_a_lost_route_even_while_frozen() -> None:
    route = weak()
    route.hear(3, 7.1, hops=3, seqno=90)
    assert route.step(0.0)[0] == 2
    route.hear(2, 8.1, hops=UNREACHABLE, seqno=103)
    route.hear(3, 7.1, hops=3, seqno=90)
    assert route.step()[0] == NOBODY


def test_b_ends_the_freeze_when_it_adopts() -> None:
    route = weak()
    route.hear(3, 7.1, hops=3, seqno=101)
    assert route.step(0.0)[0] == 3
    route.hear(3, 7.1, hops=3, seqno=103)
    assert route.step() == (3, 4, 103), "refreshed at once"


# -- rule c: shortening ------------------------------------------------------------------------------------------------


def near(**offer: float) -> int:
    """The NMS of a robot four hops away with a good link, after it heard an offer of robot 3."""
    route = Route(hops=4, nms=2)
    route.hear(2, 5.0, hops=3, seqno=100)
    route.hear(3, **{"distance_m": 6.4, "hops": 2, "seqno": 100, **offer})  # type: ignore[arg-type]
    return route.step()[0]


def test_c_adopts_a_near_neighbor_that_saves_a_hop_and_whose_number_is_as_new() -> None:
    assert near() == 3
    assert near(seqno=101) == 3


@pytest.mark.parametrize("offer", [{"distance_m": 6.6}, {"hops": 3}, {"seqno": 99}, {"nms": ME}])
def test_c_adopts_no_other(offer: dict[str, float]) -> None:
    assert near(**offer) == 2


def test_c_takes_of_several_the_one_with_the_fewest_hops_then_the_nearest() -> None:
    for offers, best in ((((3, 6.0, 1), (4, 5.0, 2)), 3), (((3, 6.0, 1), (4, 5.0, 1)), 4)):
        route = Route(hops=4, nms=2)
        route.hear(2, 5.0, hops=3, seqno=100)
        for node, distance_m, hops in offers:
            route.hear(node, distance_m, hops=hops, seqno=100)
        assert route.step()[0] == best


def test_c_can_be_switched_off() -> None:
    route = Route(hops=4, nms=2, shortcut_share=0.0)
    route.hear(2, 5.0, hops=3, seqno=100)
    route.hear(3, 1.0, hops=1, seqno=100)
    assert route.step()[0] == 2


# -- what the NMS says -------------------------------------------------------------------------------------------------


def test_the_acknowledgements_of_the_ms_are_those_that_the_nms_said_last() -> None:
    route = Route()
    route.hear(2, 5.0, hops=3)
    route.neighbors.by_id[2].acks, route.neighbors.by_id[2].acks_version = b"12345678", 9
    route.neighbors.by_id[2].ahead = b"a"
    route.step()
    assert (route.route.acks, route.route.acks_version, route.route.ahead) == (b"12345678", 9, b"a")
