"""The rules of policy sortie (docs/sortie.md), each decision with its switch on and off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from agents.explorer import Explorer
from agents.forwarding_table import freshness_of
from agents.sortie import Sortie
from agents.vds import STILL
from tests.helpers.stage import CORNER, TRACE_M_S, Stage
from world.grid import FREE, OCCUPIED, UNKNOWN
from world.terms import NOBODY, STATION, UNREACHABLE, Cls, Mode

STOPPED_TICKS = 15


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether the target of the robot is reached; the map has no frontiers of its own."""
    answer = [False]
    monkeypatch.setattr("agents.explorer.Explorer.done", lambda *_: answer[0])
    return answer


class Walk:
    """A search robot behind the wall, whose next step would lose its NMS."""

    def __init__(self, target_m: float = 4.0, **switches: float | bool) -> None:
        """`target_m`: how far its target is, in the west."""
        self.stage = Stage("sortie", **switches)
        assert isinstance(self.stage.scout, Sortie)
        self.sortie = self.stage.scout
        self.stage.walk_west_until_the_wall_hides(CORNER)
        x, y = self.stage.body.at
        self.sortie.target = x - target_m, y
        self.left_at = self.stage.body.at

    def tick(self, *, routed: bool = True) -> tuple[tuple[float, float], Mode]:
        """One tick; `routed`: the NMS is heard."""
        body = self.stage.body
        body.tick += 1
        if routed:
            self.stage.other(2, CORNER, cls=Cls.RR)
            self.stage.nms(2)
        else:
            body.router.table.set_route(STATION, freshness_of(2 * body.tick + 1, UNREACHABLE), NOBODY)
        velocity, mode = self.stage.decide()
        body.at = body.at[0] + 0.1 * velocity[0], body.at[1] + 0.1 * velocity[1]
        return velocity, mode

    def leave(self) -> None:
        for _ in range(STOPPED_TICKS):
            assert self.tick() == (STILL, Mode.WAIT)
        assert self.tick()[1] is Mode.AWAY


@pytest.mark.parametrize("on", [True, False])
@pytest.mark.usefixtures("reached")
def test_who_is_stopped_near_its_target_leaves_and_says_so(on: bool) -> None:
    walk = Walk(leave=on)
    modes = [walk.tick(routed=k < STOPPED_TICKS)[1] for k in range(STOPPED_TICKS)]
    assert modes == [Mode.WAIT] * STOPPED_TICKS
    velocity, mode = walk.tick()
    if on:
        assert mode is Mode.AWAY
        assert velocity[0] < -0.2
        assert not walk.sortie.need
    else:
        assert (velocity, mode) == (STILL, Mode.WAIT)


@pytest.mark.parametrize(("stalls", "farthest_m"), [(0, 6.4), (1, 12.8), (3, 51.2), (4, 51.2)])
@pytest.mark.usefixtures("reached")
def test_stalls_in_a_row_make_the_budget_longer(stalls: int, farthest_m: float) -> None:
    sortie = Walk().sortie
    sortie.explorer.stalls = stalls
    assert sortie._sorties.outward_share * sortie._sorties.pace_m_s * sortie._budget_s == pytest.approx(farthest_m)


@pytest.mark.usefixtures("reached")
def test_a_far_target_is_not_worth_a_sortie_before_a_stall() -> None:
    walk = Walk(target_m=8.0)
    for _ in range(2 * STOPPED_TICKS):
        assert walk.tick()[1] is Mode.WAIT
    walk.sortie.explorer.stalls = 1
    walk.tick()
    assert walk.tick()[1] is Mode.AWAY


@pytest.mark.usefixtures("reached")
def test_nobody_leaves_while_it_retreats_rests_or_holds_a_child() -> None:
    walk = Walk()
    for _ in range(STOPPED_TICKS):
        walk.tick()
    sortie = walk.sortie
    sortie._outing = None
    for name, value, free in (("retreat_until", 10**6, -1), ("hold", 3, NOBODY), ("_not_before", 10**6, 0)):
        owner = sortie.explorer if name == "retreat_until" else sortie
        assert sortie._may_leave()
        setattr(owner, name, value)
        assert not sortie._may_leave(), name
        setattr(owner, name, free)


def test_a_sortie_ends_at_home(reached: list[bool]) -> None:
    walk = Walk()
    walk.leave()
    while math.dist(walk.stage.body.at, walk.left_at) < 2.0:
        assert walk.tick(routed=False)[1] is Mode.AWAY
    reached[0] = True  # no other frontier is left: home
    velocity, mode = walk.tick(routed=False)
    assert mode is Mode.AWAY
    assert velocity == pytest.approx((TRACE_M_S, 0.0), abs=1e-6)
    for _ in range(int(2.0 / (0.1 * TRACE_M_S))):
        velocity, mode = walk.tick(routed=False)
    assert mode is Mode.LOST, "nobody is there any more: an unplanned absence begins"
    assert math.dist(walk.stage.body.at, walk.left_at) < 1.5


def test_a_sortie_ends_wherever_the_network_is_met(reached: list[bool]) -> None:
    walk = Walk()
    walk.leave()
    for _ in range(30):
        walk.tick(routed=False)
    reached[0] = True
    walk.tick(routed=False)
    x, y = walk.stage.body.at
    walk.stage.other(6, (x, y + 2.0), cls=Cls.RR)
    walk.stage.nms(6)
    walk.stage.body.tick += 1
    walk.stage.other(6, (x, y + 2.0), cls=Cls.RR)
    assert walk.stage.decide()[1] is not Mode.AWAY
    assert walk.sortie._outing is None


@pytest.mark.usefixtures("reached")
def test_a_sortie_keeps_the_time_for_the_way_home() -> None:
    walk = Walk(target_m=14.0, budget_s=40.0, outward_share=1.0)
    walk.leave()
    outing = walk.sortie._outing
    assert outing is not None
    begun = walk.stage.body.tick
    while not outing.returning:
        walk.tick(routed=False)
    away_m = math.dist(walk.stage.body.at, walk.left_at)
    left_s = 40.0 - 0.1 * (walk.stage.body.tick - begun)
    assert away_m / 0.4 == pytest.approx(left_s, abs=3.0)
    assert away_m > 5.0


@pytest.mark.usefixtures("reached")
def test_who_never_gets_home_looks_for_the_network_in_the_end() -> None:
    walk = Walk(overdue_s=3.0)
    walk.leave()
    assert walk.sortie._outing is not None
    walk.sortie._outing.turn_back()
    walk.sortie._outing.home = (0.75, 60.0)
    modes = [walk.tick(routed=False)[1] for _ in range(40)]
    assert modes.index(Mode.LOST) in range(28, 33)


@pytest.mark.usefixtures("reached")
def test_a_relay_stays() -> None:
    walk = Walk()
    walk.leave()
    walk.stage.body.tick += 1
    walk.stage.other(2, CORNER, cls=Cls.RR)
    assert walk.sortie.behave(Cls.RR)[1] is not Mode.AWAY


def test_the_next_frontier_is_the_nearest_from_which_the_way_home_fits(reached: list[bool]) -> None:
    walk = Walk()
    body = walk.stage.body
    g = body.map.geometry
    hidden = np.full((g.rows, g.cols), FREE, np.int8)
    walk.leave()
    x, y = body.at
    for place in ((x, y + 3.0), (x + 2.0, y)):  # two specks that nobody has seen
        row, col = divmod(g.index(*place), g.cols)
        hidden[row, col] = UNKNOWN
    body.map.cells[:] = np.where(hidden.ravel() == UNKNOWN, UNKNOWN, body.map.cells)
    reached[0] = True
    walk.tick(routed=False)
    assert walk.sortie.target == pytest.approx((x + 2.0, y), abs=1.1)
    outing = walk.sortie._outing
    assert outing is not None
    # 0.1 s of a tick at 0.4 m/s are 4 cm: of the way there and home, one would fit alone.
    there_m = math.dist(body.at, walk.sortie.target)
    back_m = math.dist(outing.home, walk.sortie.target)
    outing.until = body.tick + round((max(there_m, back_m) + 0.5 * min(there_m, back_m)) / 0.04)
    assert outing.next_frontier() is None
    outing.until = body.tick + round((there_m + back_m + 1.5) / 0.04)
    assert outing.next_frontier() is not None


@pytest.mark.parametrize(("target_m", "kept"), [(12.0, True), (14.0, False)])
@pytest.mark.usefixtures("reached")
def test_who_stalls_in_need_keeps_a_target_that_the_longer_budget_reaches(target_m: float, kept: bool) -> None:
    walk = Walk(target_m=target_m)
    for _ in range(50):
        assert walk.tick()[1] is Mode.WAIT
    assert walk.sortie.need
    target = walk.sortie.target
    walk.sortie.search()
    walk.sortie.explorer.stalls = 1
    assert (walk.sortie.choose_target() == target) == kept
    assert walk.tick()[1] is Mode.WAIT
    assert (walk.tick()[1] is Mode.AWAY) == kept


# -- join --------------------------------------------------------------------------------------------------------------


def joining(**switches: Any) -> Stage:
    """In need at 24, 8, where its NMS stands; its target is in the west, and robot 3 is a relay in between."""
    stage = Stage("sortie", **switches)
    stage.body.at, stage.scout.target = (24.0, 8.0), (5.0, 8.0)
    stage.other(2, (26.0, 10.0), cls=Cls.RR)
    stage.nms(2)
    stage.other(3, (12.0, 12.0), cls=Cls.RR, nms=2, ms_freshness=freshness_of(2, 2))
    for _ in range(50):
        stage.scout._count(stopped=True)
    assert stage.scout.need
    return stage


@pytest.mark.parametrize("on", [True, False])
@pytest.mark.usefixtures("reached")
def test_who_is_in_need_walks_to_a_neighbor_nearer_to_its_target_and_adopts_only_that(on: bool) -> None:
    stage = joining(join=on)
    velocity, mode, _ = stage.scout._move(Cls.SR)
    links = stage.body.router.ms.links
    if not on:
        assert not links.leaving()
        return
    assert mode is Mode.WALK
    assert velocity == pytest.approx((TRACE_M_S * -12.0 / math.hypot(12, 4), TRACE_M_S * 4.0 / math.hypot(12, 4)))
    adopt_m = 0.9 * 0.9 * stage.body.config.radius_m
    assert math.dist(stage.body.at, (12.0, 12.0)) < adopt_m
    assert links.leaving()
    assert links.lasting(3)
    assert not links.lasting(2)


@pytest.mark.usefixtures("reached")
def test_nobody_joins_its_own_child_nor_one_deeper_in_the_tree() -> None:
    for wrong in ({"nms": 1}, {"ms_freshness": freshness_of(2, 9)}):
        stage = joining()
        stage.other(3, (12.0, 12.0), cls=Cls.RR, **wrong)
        stage.scout._move(Cls.SR)
        assert not stage.body.router.ms.links.leaving()


@pytest.mark.usefixtures("reached")
def test_who_cannot_join_on_the_way_goes_to_its_nms_first() -> None:
    stage = joining()
    stage.body.router.neighbors.by_id.pop(3)  # only heard of
    stage.body.at = 24.0, 14.0
    velocity, mode, _ = stage.scout._move(Cls.SR)
    assert mode is Mode.WALK
    assert velocity == pytest.approx((TRACE_M_S * 2 / math.hypot(2, 4), TRACE_M_S * -4 / math.hypot(2, 4)))


@pytest.mark.usefixtures("reached")
def test_nobody_joins_a_neighbor_that_it_reaches_only_without_its_nms() -> None:
    stage = joining()
    stage.other(2, CORNER, cls=Cls.RR)  # out of sight a metre farther west
    stage.other(3, (5.0, 8.0), cls=Cls.RR, nms=2, ms_freshness=freshness_of(2, 2))
    velocity, _, _ = stage.scout._move(Cls.SR)
    way = CORNER[0] - 24.0, CORNER[1] - 8.0
    assert velocity == pytest.approx(tuple(TRACE_M_S * d / math.hypot(*way) for d in way)), "back to its NMS first"


# -- back --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("on", [True, False])
@pytest.mark.parametrize(("target_y_m", "long_way"), [(14.0, True), (2.0, False)])
@pytest.mark.usefixtures("reached")
def test_who_would_take_the_long_way_round_goes_back_up_its_chain(on: bool, target_y_m: float, long_way: bool) -> None:
    """A wall from the MS at 28, 35 to the south: robot and target on its two sides, the way around its end."""
    stage = Stage("sortie", back=on, join=False)
    body = stage.body
    grid = body.map.cells.reshape(body.map.geometry.rows, body.map.geometry.cols)
    grid[6:66, 56:58] = OCCUPIED
    body.at, stage.scout.target = (30.0, 14.0), (26.0, target_y_m)
    stage.other(2, (31.0, 18.0), cls=Cls.RR, nms=5)
    stage.other(5, (30.0, 24.0), cls=Cls.RR)
    stage.nms(2)
    velocity, mode, _ = stage.scout._move(Cls.SR)
    assert mode is Mode.WALK
    assert velocity[1] == pytest.approx(TRACE_M_S) if on and long_way else velocity[1] < 0.0


# -- depth -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("on", [True, False])
def test_who_stalled_in_need_takes_shallower_frontiers(on: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def stall(explorer: Explorer, *_: object) -> bool:
        explorer.stalls += 1
        return True

    stage = Stage("sortie", depth=on, leave=False)
    body, scout = stage.body, stage.scout
    g = body.map.geometry
    body.at = 24.0, 8.0
    specks = ((20.0, 8.0), (30.0, 12.0))
    deep, shallow = (body.ms_distance([place])[0] for place in specks)
    assert deep > body.ms_distance([body.at])[0] - 3.0 > shallow
    for place in specks:
        body.map.cells[g.index(*place)] = UNKNOWN
    stage.other(2, (26.0, 10.0), cls=Cls.RR)
    stage.nms(2)
    for _ in range(50):
        scout._count(stopped=True)
    scout.search()
    assert scout.target == pytest.approx(specks[0], abs=1.1)
    monkeypatch.setattr("agents.explorer.Explorer.done", lambda *_: False)
    monkeypatch.setattr("agents.explorer.Explorer.stalled", stall)
    scout.search()
    assert scout.target == pytest.approx(specks[1 if on else 0], abs=1.1)
    body.tick += 1201
    assert scout.choose_target() == pytest.approx(specks[0], abs=1.1), "only for two minutes"
