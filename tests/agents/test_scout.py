"""The rules of policy scout (docs/scout.md), each decision with its switch on and off."""

from __future__ import annotations

import math

import pytest

from agents.scout import Scout
from agents.vds import STILL
from tests.helpers.stage import CORNER, TRACE_M_S, WEST, Stage
from world.terms import Cls, Mode


def assert_walks_west(velocity: tuple[float, float]) -> None:
    assert velocity[0] < -0.2
    assert velocity[1] == pytest.approx(0.0)


@pytest.fixture(autouse=True)
def targets_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole map is known, so the target is no frontier; the test is of the path to it."""
    monkeypatch.setattr("agents.explorer.Explorer.done", lambda *_: False)


def test_a_wall_puts_a_neighbor_out_of_predicted_reach() -> None:
    stage = Stage()
    stage.other(2, (15.0, 1.0), cls=Cls.RR)
    stage.other(3, (1.0, 8.0), cls=Cls.RR)
    assert stage.scout.links.predicted_m((1.0, 1.0), 2) == pytest.approx(14.0)
    assert stage.scout.links.predicted_m((1.0, 1.0), 3) == math.inf


def test_need_grows_slowly_and_falls_fast() -> None:
    scout = Stage().scout
    for _ in range(49):
        scout._count(stopped=True)
    assert not scout.need
    scout._count(stopped=True)
    assert scout.need
    for _ in range(100):
        scout._count(stopped=True)
    for _ in range(5):
        scout._count(stopped=False)
    assert not scout.need, "from 70 down by 5 a tick"


@pytest.mark.parametrize("on", [True, False])
def test_b_stands_rather_than_lose_its_nms_behind_a_wall(on: bool) -> None:
    stage = Stage(predict=on)
    stage.walk_west_until_the_wall_hides(CORNER)
    stage.other(2, CORNER, cls=Cls.RR)
    stage.nms(2)
    velocity, mode = stage.decide()
    links = stage.body.router.ms.links
    if on:
        assert (velocity, mode) == (STILL, Mode.WAIT)
        stage.other(3, (15.0, 8.0))
        assert links.leaving()
        assert links.lasting(3)
        assert not links.lasting(2)
    else:
        assert_walks_west(velocity)
        assert not links.leaving()


@pytest.mark.parametrize("on", [True, False])
def test_c_stands_rather_than_hide_from_a_child_and_asks_it_to_yield(on: bool) -> None:
    stage = Stage(shield=on)
    stage.walk_west_until_the_wall_hides(CORNER)
    stage.other(2, (15.0, 8.0), cls=Cls.RR)
    stage.nms(2)
    stage.other(3, CORNER, nms=1)
    stage.body.router.inv = [3]
    velocity, mode = stage.decide()
    if on:
        assert (velocity, mode, stage.scout.hold) == (STILL, Mode.WAIT, 3)
    else:
        assert_walks_west(velocity)


@pytest.mark.parametrize("on", [True, False])
def test_who_is_held_traces_its_nms(on: bool) -> None:
    stage = Stage(shield=on)
    stage.body.at, stage.scout.target = (24.0, 8.0), WEST
    stage.other(2, (24.0, 12.0), cls=Cls.RR, hold=1)
    stage.nms(2)
    velocity, mode = stage.decide()
    if on:
        assert mode is Mode.INNER
        assert velocity == pytest.approx((0.0, TRACE_M_S))
    else:
        assert_walks_west(velocity)


@pytest.mark.parametrize("on", [True, False])
@pytest.mark.parametrize(("target", "far"), [(WEST, True), ((16.0, 8.0), False)])
def test_d_hurries_while_the_target_is_far(on: bool, target: tuple[float, float], far: bool) -> None:
    stage = Stage(hurry=on)
    stage.body.at, stage.scout.target = (24.0, 8.0), target
    stage.other(2, (24.0, 12.0), cls=Cls.RR)
    stage.nms(2)
    stage.decide()  # the path is there from the second tick on
    velocity, _ = stage.decide()
    assert math.hypot(*velocity) == pytest.approx(TRACE_M_S if on and far else TRACE_M_S / 2)


def in_need(stage: Stage) -> Scout:
    """At 24, 8 in need, with a deeper robot in need and a shallower one that is not."""
    scout = stage.scout
    stage.body.at, scout.target = (24.0, 8.0), (24.0, 1.0)
    stage.other(2, (24.0, 12.0), cls=Cls.RR)
    stage.nms(2)
    for _ in range(50):
        scout._count(stopped=True)
    stage.other(4, (10.0, 8.0), target=WEST, need=True)
    stage.other(5, (25.0, 12.0), target=(30.0, 12.0))
    return scout


@pytest.mark.parametrize("on", [True, False])
def test_recruit_takes_over_the_target_of_a_deeper_robot_in_need(on: bool) -> None:
    stage = Stage(recruit=on)
    scout = in_need(stage)
    near, deep = stage.body.ms_distance([stage.body.at, (10.0, 8.0)])
    assert deep > near + 2.0
    scout._recruit()
    assert scout.target == (WEST if on else (24.0, 1.0))
    stage.other(4, (10.0, 8.0), target=(3.0, 9.0), need=True)
    scout._recruit()
    assert scout.target == ((3.0, 9.0) if on else (24.0, 1.0)), "and follows where that one goes next"


def test_recruit_follows_nobody_who_is_nearer_to_the_ms() -> None:
    stage = Stage()
    scout = in_need(stage)
    stage.body.at = 10.0, 8.0
    stage.other(4, (24.0, 8.0), target=WEST, need=True)
    scout._recruit()
    assert scout.target == (24.0, 1.0)


@pytest.mark.parametrize("on", [True, False])
def test_wait_is_patient_while_somebody_may_come(on: bool) -> None:
    scout = in_need(Stage(wait=on, recruit=False))
    scout._recruit()
    assert scout.explorer.patience_s == ((90.0, 270.0) if on else (20.0, 60.0))


def test_wait_ends_when_all_are_in_need_for_targets_of_their_own() -> None:
    stage = Stage(recruit=False)
    scout = in_need(stage)
    stage.other(5, (25.0, 12.0), target=(30.0, 12.0), need=True)
    scout._recruit()
    assert scout.explorer.patience_s == (20.0, 60.0)


@pytest.mark.parametrize("on", [True, False])
def test_stretch_reaches_farther_until_the_nms_is_near(on: bool) -> None:
    stage = Stage(stretch=on)
    scout, ms = in_need(stage), stage.body.router.ms
    radius_m = stage.body.config.radius_m
    stage.other(2, (24.0, 8.0 + 0.8 * radius_m), cls=Cls.RR)
    scout._stretch(Cls.SR)
    assert ms.links.reach_m == pytest.approx((0.95 if on else 0.9) * radius_m)
    stage.other(2, (24.0, 12.0), cls=Cls.RR)
    scout._stretch(Cls.SR)
    assert ms.links.reach_m == pytest.approx(0.9 * radius_m)
