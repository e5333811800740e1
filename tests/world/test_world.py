"""The world's core with given motions: movement, senses, and the end of a run."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.helpers.hand_driven import Run, config
from world.config import Fault, Lidar
from world.core import World
from world.feed import SIGNALS, Signal
from world.grid import GridGeometry
from world.grid.lines import walls_crossed
from world.messages import Report, Sense, Status
from world.motion import move
from world.terms import NOBODY, UNREACHABLE, Cls, Mode

# Movement


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, 1000),
    st.lists(st.tuples(st.floats(-30, 30), st.floats(-30, 30)), min_size=1, max_size=30),
    st.sampled_from([0.5, 5.0, 60.0]),
)
def test_a_robot_never_enters_or_crosses_a_wall(seed: int, path: list[tuple[float, float]], top: float) -> None:
    generator = np.random.default_rng(seed)
    walls = generator.random((16, 16)) < 0.3
    walls[[0, -1]] = walls[:, [0, -1]] = True
    geometry = GridGeometry(16, 16, 0.25, -2.0, 1.0)
    free = np.flatnonzero(~walls)
    places = geometry.centers(generator.choice(free, 5))
    for velocity in path:
        moved = move(walls, geometry, places, [velocity] * 5, top)
        cells = np.floor((moved - (-2.0, 1.0)) / 0.25).astype(int)
        assert not walls[cells[:, 1], cells[:, 0]].any()
        assert not walls_crossed(walls, geometry, places, moved).any()
        assert (np.hypot(*(moved - places).T) <= top * 0.1 + 1e-9).all()
        places = moved


def one_move(x: float, y: float, vx: float, vy: float, top: float = 10.0) -> NDArray[np.float64]:
    walls = np.zeros((8, 8), bool)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    walls[4, 4] = True  # x and y from 2.0 to 2.5
    moved: NDArray[np.float64] = move(walls, GridGeometry(8, 8), np.array([[x, y]]), [(vx, vy)], top)[0]
    return moved


def test_free_motion_is_velocity_times_a_tick() -> None:
    assert one_move(1.0, 1.0, 1.0, -0.5) == pytest.approx([1.1, 0.95])


def test_speed_is_capped_in_its_direction() -> None:
    assert one_move(1.0, 1.0, 30.0, 40.0, top=1.0) == pytest.approx([1.06, 1.08])


def test_walls_let_slide_along_x_then_y_or_stop() -> None:
    assert one_move(2.25, 1.95, 1.0, 1.0) == pytest.approx([2.35, 1.95]), "wall above: slides along x"
    assert one_move(1.95, 2.25, 1.0, 1.0) == pytest.approx([1.95, 2.35]), "wall to the right: slides along y"
    assert one_move(2.25, 1.95, 0.0, 1.0) == pytest.approx([2.25, 1.95]), "straight into it: stays"
    assert one_move(0.55, 0.55, -1.0, -1.0) == pytest.approx([0.55, 0.55]), "in a corner: stays"


def test_a_fast_robot_does_not_jump_over_a_wall() -> None:
    assert one_move(1.8, 2.25, 10.0, 0.0)[0] == pytest.approx(1.8)


def test_the_world_moves_those_who_take_part() -> None:
    run = Run(config(2))
    run.velocity = {1: (0.5, 0.0), 2: (0.0, -0.5)}
    run.until(9)
    begin = run.world.begin()
    assert begin.positions.nodes.tolist() == [0, 1, 2]
    assert begin.positions.xy_m == pytest.approx(np.array([[2.25, 5.0], [3.5, 5.0], [4.0, 4.5]]))
    assert (begin.senses[1].x_m, begin.senses[1].y_m) == pytest.approx((3.5, 5.0))


# Senses


def test_scans_come_at_the_first_tick_and_at_the_robots_own_turns() -> None:
    run = Run(config(3))
    run.until(12)
    for node in (1, 2, 3):
        scanned = [b.tick for b in run.begun if b.senses[node].ranges_m is not None]
        assert scanned == [t for t in range(13) if t == 0 or (t + node) % 5 == 0]
    assert all(b.senses[0].ranges_m is None for b in run.begun)
    assert [b.tick for b in run.begun if b.senses[2].first] == [0]
    assert [b.tick for b in run.begun if b.senses[0].first] == [0]


def test_victims_are_seen_in_range_and_in_sight_only() -> None:
    victims = np.array([[5.0, 8.0], [5.0, 11.0], [3.0, 13.5], [4.0, 4.0]])
    run = Run(config(1, victims_m=victims))
    run.tick()
    assert [v for v, _, _ in run.begun[0].senses[1].victims] == [0, 3], "one is behind the wall, one too far"
    assert run.begun[0].senses[1].victims[0] == (0, 5.0, 8.0)
    run.tick()
    assert run.begun[1].senses[1].victims == (), "only together with a scan"


def test_noise_is_seeded_and_keeps_ranges_within_bounds() -> None:
    def senses(seed: int, **noise: float) -> list[Sense]:
        lidar = Lidar(noise_m=noise.get("lidar", 0.0))
        run = Run(config(2, seed=seed, lidar=lidar, pose_noise_m=noise.get("pose", 0.0)))
        run.until(5)
        return [b.senses[1] for b in run.begun]

    exact, noisy, again, other = senses(1), senses(1, lidar=0.5), senses(1, lidar=0.5), senses(2, lidar=0.5)
    a, b, c, d = (s[0].ranges_m for s in (exact, noisy, again, other))
    assert a is not None
    assert b is not None
    assert c is not None
    assert d is not None
    assert np.array_equal(b, c)
    assert not np.array_equal(b, d)
    assert ((b >= 0) & (b <= 8.0)).all()
    assert (b[a == 8.0] == 8.0).all(), "noise does not make walls"
    assert 0.3 < (b - a)[(a < 6.0) & (a > 2.0)].std() < 0.7
    posed = senses(1, pose=0.2)
    assert len({s.x_m for s in posed}) == len(posed)
    assert [s.x_m for s in posed] == [s.x_m for s in senses(1, pose=0.2)]


# Who takes part


def test_nothing_begins_before_everybody_is_there() -> None:
    world = World(config(2))
    assert world.awaited() == {0, 1, 2}
    with pytest.raises(RuntimeError, match="awaited"):
        world.begin()
    for node in (2, 0, 1):
        world.arrive(node, new=True)
    assert world.awaited() == frozenset()
    assert list(world.begin().senses) == [0, 1, 2]
    with pytest.raises(RuntimeError, match="cannot begin"):
        world.begin()
    with pytest.raises(RuntimeError, match=r"motions missing of \[1, 2\]"):
        world.end({}, None)
    with pytest.raises(ValueError, match="has a living process already"):
        world.arrive(1, new=True)


# The end of a run


def report(tick: int, rates: tuple[float, ...], found: tuple[int, ...] = ()) -> Report:
    return Report(tick, all(r >= 1 for r in rates), rates, 7, found)


def test_events_between_snapshots() -> None:
    run = Run(config(2, cell_names=("left", "right"), victims_m=np.zeros((5, 2))))
    run.tick(report=report(0, (0.5, 0.0)))
    run.status[2] = Status(cls=Cls.RR, nms=NOBODY, hops=UNREACHABLE)
    end = run.tick(report=report(1, (1.0, 0.2), (4,)))
    assert [(e.kind, e.node, e.tick) for e in end.events] == [
        ("role", 2, 1),
        ("link", 2, 1),
        ("victim", 0, 1),
        ("mission", 0, 1),
    ]
    assert end.events[0].data == {"cls": "RR"}
    assert end.events[1].data == {"recovered": False}
    assert "left" in end.events[3].text
    run.status[2] = Status(cls=Cls.RR, nms=1, hops=2)
    end = run.tick(report=None)
    assert [(e.kind, e.data) for e in end.events] == [("link", {"recovered": True, "nms": 1, "hops": 2})]
    assert end.snapshot.search_rate == (1.0, 0.2), "the station's last word stands while it is away"
    end = run.tick(report=report(3, (1.0, 1.0), (4,)))
    assert [e.data["cell"] for e in end.events] == ["right", "all"]
    assert end.stop is not None
    assert end.stop.reason == "searched"
    assert run.world.final()["status"] == "searched"


def test_the_time_limit() -> None:
    run = Run(config(1, duration_s=2.0))
    while run.tick().stop is None:
        pass
    assert run.ended[-1].stop is not None
    assert run.ended[-1].stop.reason == "time_limit"
    assert run.world.final()["ticks"] == 20


def test_a_planned_absence_is_no_lost_path_and_counts_apart() -> None:
    run = Run(config(2))
    gone = {"nms": NOBODY, "hops": UNREACHABLE}
    told = []
    for k in range(20):
        # Robot 1 leaves at tick 5, is back at 12, and leaves again at 15; robot 2 loses its path at tick 5.
        away = 5 <= k < 12 or k >= 15
        run.status[1] = Status(mode=Mode.AWAY, **gone) if away else Status(nms=0, hops=1)
        run.status[2] = Status(mode=Mode.LOST, **gone) if k >= 5 else Status(nms=0, hops=1)
        told += [(event.node, event.tick, event.text, event.data) for event in run.tick().events]
    assert [event for event in told if event[1] == 5] == [
        (1, 5, "robot 1 is on a sortie", {"recovered": False, "planned": True}),
        (2, 5, "robot 2 lost its route to the MS", {"recovered": False}),
    ]
    final = run.world.final()
    assert final["planned_absences"] == {"count": 2, "fraction": 12 / 40, "longest_s": 0.7}
    assert final["connected_fraction"] == (8 + 5) / 40
    assert final["longest_absence_s"] == 1.5, "a lost path counts among the absences"


def test_interrupted_and_failed() -> None:
    run = Run(config(1))
    run.world.interrupt()
    stop = run.tick().stop
    assert stop is not None
    assert (stop.reason, run.world.final()["status"]) == ("interrupted", "interrupted")
    other = Run(config(1))
    assert other.world.fail("the medium is gone").reason == "failed"
    assert (other.world.final()["status"], other.world.final()["why"]) == ("failed", "the medium is gone")


def test_final_counts() -> None:
    run = Run(config(2, faults=(Fault("restart", 1.0, "2", 0.5),)))
    run.status[1] = Status(nms=0, hops=1, reports_made=10, reports_buffered=2, reports_discarded=1)
    run.status[2] = Status(nms=NOBODY, hops=UNREACHABLE, reports_made=5, reports_buffered=5)
    run.until(14)
    run.status[2] = Status(nms=1, hops=2, reports_made=3, reports_buffered=1)
    run.until(19)
    final = run.world.final()
    assert final["scan_reports"] == {"made": 18, "buffered": 3, "discarded": 1}
    assert final["connected_fraction"] == pytest.approx((20 + 5) / (20 + 15))
    assert final["max_hops"] == 2
    assert final["longest_absence_s"] == 1.0, "who takes no part is not absent from the network"


def test_when_each_scan_was_made_is_kept_by_incarnation() -> None:
    run = Run(config(2, faults=(Fault("restart", 1.0, "2", 0.5),)))
    for made, scan_tick in ((0, 0), (1, 0), (1, 0), (2, 3), (3, 3)):
        run.status[2] = Status(nms=0, hops=1, reports_made=made, reports_buffered=0, newest_scan_tick=scan_tick)
        run.tick()
    run.until(14)
    run.status[2] = Status(nms=0, hops=1, reports_made=1, newest_scan_tick=15)
    run.until(16)
    run.status[2] = Status(nms=0, hops=1, reports_made=0)
    run.until(17)
    assert run.world.final()["scan_ticks"] == {"2/0": [0, 3, 3], "2/1": [15]}


def test_what_robots_walk_is_what_they_come_forward() -> None:
    run = Run(config(2, starts_m=((1.5, 1.5), (3.5, 3.5))))
    before = run.tick().snapshot.xy_m
    run.velocity = {1: (0.2, 0.0), 2: (0.0, -0.1)}
    after = run.until(11).snapshot.xy_m
    assert np.hypot(*(after - before).T).sum() == pytest.approx(10 * (0.02 + 0.01))
    assert run.world.final()["walked_m"] == 0.3


def test_two_worlds_are_the_same_to_the_bit() -> None:
    def trace() -> list[bytes]:
        faults = (Fault("kill", 1.0, "random"), Fault("loss", 2.0, "", 1.0, 0.1), Fault("restart", 2.0, "random", 0.7))
        run = Run(config(4, faults=faults, pose_noise_m=0.1, lidar=Lidar(noise_m=0.1)))
        run.velocity = {n: (math.cos(n), math.sin(n)) for n in range(1, 5)}
        run.until(60)
        return [b.positions.encode() + b"".join(s.encode() for s in b.senses.values()) for b in run.begun]

    assert trace() == trace()


@pytest.mark.parametrize("verb", SIGNALS)
def test_signal_wire_form(verb: str) -> None:
    signal = Signal(7, 3, verb)
    assert Signal.decode(signal.encode()) == signal
    with pytest.raises(ValueError, match="not one of"):
        Signal.decode(Signal(7, 3, "hug").encode())
