"""The paper's worked example: robot C's forwarding table (Fig. 2) and its choice of E [paper 2.4, 4.4].

The rules are tested, not the geometry: row E of Fig. 2 is 2 hops via D, yet lies 179 units from D where every other
link is 33 to 40 long, so its printed location is probably a misprint. As printed it still is the farthest SR.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config import Classing
from agents.dsdv import Router
from agents.forwarding_table import freshness_of
from agents.messages import Update
from agents.srrc import Classifier, eligible_msrs, farthest_msr
from tests.helpers.routing_field import power_dbm, router_config
from world.terms import NOBODY, Cls

MS, A, B, C, D, E, F, G, H, I = range(10)  # noqa: E741 - the paper's own letters
LOCATION = {
    MS: (223.5, 466.8), A: (210.9, 502.1), B: (222.4, 533.6), C: (258.0, 552.0), D: (293.6, 574.4), E: (114.4, 568.4),
    F: (151.6, 564.4), G: (189.6, 554.4), H: (271.6, 519.6), I: (288.4, 485.6),
}  # fmt: skip
CLASS = {A: Cls.RR, B: Cls.RR, D: Cls.RR, E: Cls.SR, F: Cls.SR, G: Cls.RR, H: Cls.RR, I: Cls.SR}
HEARD = {B: ({MS: 2, A: 1, B: 0, F: 2, G: 1}, A), D: ({D: 0, E: 1}, C), H: ({H: 0, I: 1}, C)}
"""What C's neighbors advertise (hop counts as theirs), and their NMS."""
FIGURE_2 = {
    MS: (B, 3), A: (B, 2), B: (B, 1), D: (D, 1), E: (D, 2), F: (B, 3), G: (B, 2), H: (H, 1), I: (H, 2),
}  # fmt: skip
TICK = 10


def robot_called(name: Mapping[int, int], rng: random.Random) -> Router:
    """Robot C after its neighbors' updates, where the robots have other ids, and rows come in any order."""
    router = Router(router_config(name[C], radius_m=60.0), rng, 0)
    heard = []
    for node, (hops, nms) in HEARD.items():
        other = Router(router_config(name[node]), rng, 0)
        for dst, hop in rng.sample(sorted(hops.items()), len(hops)):
            other.table.set_route(name[dst], freshness_of(2 * (TICK - 1 - hop), hop), name[dst])
            other.table.set_inherent(name[dst], CLASS.get(dst, Cls.RR), LOCATION[dst], LOCATION[dst])
        update = Update(name[nms], NOBODY, 0, other.table.advertised(), b"").encode()
        heard.append((name[node], power_dbm(math.dist(LOCATION[node], LOCATION[C])), update))
    router.step(TICK, sorted(heard))
    router.announce_self(TICK, LOCATION[C], Cls.RR, LOCATION[C])
    return router


@pytest.fixture
def robot_c() -> Router:
    return robot_called({node: node for node in range(10)}, random.Random(0))


def distance_to_ms(x_m: float, y_m: float) -> float:
    return math.dist((x_m, y_m), LOCATION[MS])


def select_msr(router: Router, present: int, margin_m: float) -> int:
    candidates = eligible_msrs(router.table, router.ms.nms)
    return farthest_msr(
        candidates, router.table, lambda places: [distance_to_ms(*p) for p in places], present, margin_m
    )


def test_dsdv_elements_are_as_printed(robot_c: Router) -> None:
    table = robot_c.table
    assert {dst: (table.next_hop_to(dst), table.hop(dst)) for dst in FIGURE_2} == FIGURE_2
    assert robot_c.ms.nms == B


def test_srrc_elements_are_as_printed(robot_c: Router) -> None:
    shown = robot_c.shown(TICK, E)
    inv = dict(zip(shown.dst.tolist(), shown.inv.tolist(), strict=True))
    assert [dst for dst, mark in inv.items() if mark] == [D, H]
    classes = dict(zip(shown.dst.tolist(), shown.cls.tolist(), strict=True))
    assert {dst: classes[dst] for dst in CLASS} == CLASS
    assert robot_c.table.location_m(E) == pytest.approx(LOCATION[E])


def test_c_is_a_relay_because_its_inv_is_not_empty(robot_c: Router) -> None:
    assert Classifier(Classing()).step(TICK, robot_c.neighbors.naming(C)) is Cls.RR


@given(st.permutations(range(1, 10)), st.randoms(use_true_random=False))
def test_no_element_depends_on_the_ids_or_on_the_order_of_rows(ids: list[int], rng: random.Random) -> None:
    name = {MS: MS, **dict(zip(range(1, 10), ids, strict=True))}
    router = robot_called(name, rng)
    table = router.table
    elements = {dst: (table.next_hop_to(name[dst]), table.hop(name[dst])) for dst in FIGURE_2}
    assert elements == {dst: (name[hop], hops) for dst, (hop, hops) in FIGURE_2.items()}
    assert router.inv == sorted([name[D], name[H]])
    assert {dst: table.cls(name[dst]) for dst in CLASS} == CLASS
    assert eligible_msrs(table, router.ms.nms) == sorted([name[E], name[I]])
    assert select_msr(router, NOBODY, 2.0) == name[E]


def test_e_and_i_are_left_by_rule_1(robot_c: Router) -> None:
    assert eligible_msrs(robot_c.table, robot_c.ms.nms) == [E, I]


def test_c_selects_e(robot_c: Router) -> None:
    assert select_msr(robot_c, NOBODY, 2.0) == E


def test_f_is_discarded_by_rule_1_although_it_is_far(robot_c: Router) -> None:
    """With E gone, I is chosen, not F: F is farther from the MS than I, but beyond the NMS."""
    robot_c.table.set_route(E, freshness_of(2 * TICK + 1, 255), NOBODY)
    assert distance_to_ms(*LOCATION[F]) > distance_to_ms(*LOCATION[I])
    assert select_msr(robot_c, NOBODY, 2.0) == I


def test_the_present_msr_stays_unless_another_is_clearly_farther(robot_c: Router) -> None:
    gap = distance_to_ms(*LOCATION[E]) - distance_to_ms(*LOCATION[I])
    assert select_msr(robot_c, I, gap + 0.1) == I
    assert select_msr(robot_c, I, gap - 0.1) == E
