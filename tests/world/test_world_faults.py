"""Departures, returns and faults: who takes part in which tick, and how it is logged."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from tests.helpers.hand_driven import Run, chain, config
from world.account import Told
from world.config import Fault, Lidar
from world.core import DIED
from world.faults import check_fault, describe, fault_form, parse_fault, resolve
from world.feed import Signal, Snapshot
from world.messages import Report, Status
from world.terms import NOBODY, UNREACHABLE, Cls

# Departures that nobody scheduled


@pytest.mark.parametrize("counted", [False, True])
def test_a_death_nobody_scheduled(counted: bool) -> None:
    run = Run(config())
    run.until(19)
    run.begun.append(run.world.begin())
    motions = run.motions()
    run.world.depart(2, "died", counted=counted)
    run.world.depart(2, "died", counted=counted)
    if not counted:
        del motions[2]
    run.end(motions)
    run.until(30)
    assert run.present_at(2) == list(range(21))
    assert run.world.awaited() == frozenset()
    form = {"verb": "kill", "target": "2", "at_s": 2.1 if counted else 2.0}
    assert [event.data for event in run.faults] == [form | {"cause": "died"}]
    final = run.world.final()
    assert final["faults"] == [form]
    assert final["wall_clock_faults"] == 1
    assert run.ended[-1].snapshot.present.tolist() == [1, 0, 1, 1]
    assert run.ended[-1].snapshot.nms.tolist() == [0, NOBODY, 2, 3]


def test_a_return_turns_the_entry_into_a_restart_that_replays() -> None:
    run = Run(config())
    run.until(19)
    run.world.depart(2, "died", counted=False)
    run.until(49)
    run.world.arrive(2, new=True)
    run.tick()
    assert run.begun[-1].tick == 50
    assert run.begun[-1].senses[2].first
    assert run.begun[-1].senses[2].incarnation == 1
    entry = run.world.final()["faults"]
    assert entry == [{"verb": "restart", "target": "2", "at_s": 2.0, "for_s": 3.0}]
    run.until(60)

    replay = Run(config(faults=(Fault(**entry[0]),)))
    replay.until(60)
    assert replay.present_at(2) == run.present_at(2)
    assert [b.senses[2].incarnation for b in replay.begun if 2 in b.senses] == [
        b.senses[2].incarnation for b in run.begun if 2 in b.senses
    ]
    assert replay.world.final()["wall_clock_faults"] == 0
    assert replay.world.final()["recoveries"] == run.world.final()["recoveries"]


def test_a_hung_robot_that_thaws_was_paused() -> None:
    run = Run(config())
    run.until(19)
    run.world.depart(3, "unresponsive", counted=True)
    run.until(29)
    run.world.arrive(3, new=False)
    run.tick()
    sense = run.begun[-1].senses[3]
    assert (sense.first, sense.incarnation) == (True, 0)
    assert run.world.final()["faults"] == [{"verb": "pause", "target": "3", "at_s": 2.0, "for_s": 1.0}]


def test_a_dead_robot_does_not_thaw() -> None:
    run = Run(config())
    run.until(3)
    run.world.depart(3, "unresponsive", counted=False)
    run.world.depart(3, "died", counted=False)
    run.world.arrive(3, new=False)
    run.until(6)
    assert run.present_at(3) == [0, 1, 2, 3]
    assert run.world.final()["wall_clock_faults"] == 1


def test_nobody_leaves_and_joins_within_a_tick() -> None:
    run = Run(config())
    run.until(4)
    run.begun.append(run.world.begin())
    run.world.depart(1, "died", counted=True)
    run.world.arrive(1, new=True)
    run.end(run.motions())
    run.until(8)
    assert run.present_at(1) == [0, 1, 2, 3, 4, 5, 7, 8]
    assert run.world.final()["faults"] == [{"verb": "restart", "target": "1", "at_s": 0.6, "for_s": 0.1}]


# Scheduled faults


def test_kill_is_for_good() -> None:
    run = Run(config(faults=(Fault("kill", 2.0, "3"),)))
    run.until(30)
    assert run.present_at(3) == list(range(20))
    assert run.signals == [Signal(20, 3, "kill")]
    assert run.faults[0].tick == 20
    run.world.depart(3, "died", counted=False)
    assert run.world.final()["wall_clock_faults"] == 0, "its end was asked for"


def test_restart_spawns_at_once_and_is_held_until_the_process_is_there() -> None:
    run = Run(config(faults=(Fault("restart", 2.0, "3", 1.5),)))
    run.until(19)
    run.tick(arrive=False)
    assert run.signals == [Signal(20, 3, "kill"), Signal(20, 3, "spawn")]
    for _ in range(14):
        assert run.world.awaited() == frozenset()
        run.tick(arrive=False)
    assert run.world.awaited() == {3}
    with pytest.raises(RuntimeError, match=r"awaited \[3\]"):
        run.world.begin()
    run.world.arrive(3, new=True)
    run.until(40)
    assert run.present_at(3) == [*range(20), *range(35, 41)]
    back = run.begun[35].senses[3]
    assert (back.first, back.incarnation, back.ranges_m is not None) == (True, 1, True)
    assert not run.begun[36].senses[3].first


def test_a_process_that_is_early_waits_until_it_is_due() -> None:
    run = Run(config(faults=(Fault("restart", 2.0, "3", 1.5),)))
    run.until(22)
    run.world.arrive(3, new=True)
    run.until(40)
    assert run.present_at(3) == [*range(20), *range(35, 41)]


def test_pause_comes_back_by_itself_with_the_same_incarnation() -> None:
    run = Run(config(faults=(Fault("pause", 2.0, "station", 1.0),)))
    run.until(40)
    assert run.present_at(0) == [*range(20), *range(30, 41)]
    assert run.signals == [Signal(20, 0, "stop"), Signal(30, 0, "cont")]
    assert (run.begun[30].senses[0].first, run.begun[30].senses[0].incarnation) == (True, 0)


def test_a_paused_process_that_dies_stays_away() -> None:
    run = Run(config(faults=(Fault("pause", 2.0, "2", 1.0),)))
    run.until(24)
    run.world.depart(2, "died", counted=False)
    run.until(40)
    assert run.present_at(2) == list(range(20))
    assert run.world.final()["wall_clock_faults"] == 1


def test_faults_on_who_is_away() -> None:
    faults = (Fault("kill", 1.0, "2"), Fault("kill", 2.0, "2"), Fault("pause", 2.0, "2", 1.0))
    run = Run(config(faults=(*faults, Fault("restart", 3.0, "2", 1.0))))
    run.until(45)
    assert run.present_at(2) == [*range(10), *range(40, 46)]
    assert [s.verb for s in run.signals] == ["kill", "spawn"]
    assert [f.data for f in run.faults if "nothing done" in f.text] == [{}, {}]
    assert [f["verb"] for f in run.world.final()["faults"]] == ["kill", "restart"]


def test_two_robots_killed_in_one_tick() -> None:
    run = Run(config(faults=(Fault("kill", 2.0, "relay:first"), Fault("kill", 2.0, "relay:mid"))))
    run.until(25)
    assert [s.node for s in run.signals] == [1, 2]


def test_jam_and_loss_are_in_the_positions_while_they_last() -> None:
    jam = (Fault("jam", 1.0, "1,2", 1.0), Fault("jam", 1.5, "1,2,3,4", 1.0))
    run = Run(config(faults=(*jam, Fault("loss", 1.0, "", 1.0, 0.5), Fault("loss", 1.5, "", 1.0, 0.2))))
    run.until(30)
    jams = [len(b.positions.jams) for b in run.begun]
    assert jams == [0] * 10 + [1] * 5 + [2] * 5 + [1] * 5 + [0] * 6
    assert run.begun[10].positions.jams[0].pair == (1, 2)
    assert run.begun[22].positions.jams[0].region_m == (1.0, 2.0, 3.0, 4.0)
    losses = [b.positions.loss for b in run.begun]
    assert losses == pytest.approx([0.0] * 10 + [0.5] * 5 + [0.6] * 5 + [0.2] * 5 + [0.0] * 6)


def test_a_fault_by_hand_acts_at_the_next_tick_and_is_logged_for_replay() -> None:
    run = Run(config())
    run.until(12)
    run.world.inject(Fault("restart", 0.0, "relay:first", 1.0))
    run.until(30)
    form = {"verb": "restart", "at_s": 1.3, "target": "1", "for_s": 1.0}
    assert run.faults[0].data == form | {"asked": "restart:relay:first@1.3+1"}
    assert run.world.final()["faults"] == [form]
    assert run.world.final()["wall_clock_faults"] == 1
    assert run.present_at(1) == [*range(13), *range(23, 31)]
    with pytest.raises(ValueError, match="only robots 1 to 4"):
        run.world.inject(Fault("kill", 0.0, "9"))


def test_random_is_seeded() -> None:
    def killed(seed: int) -> int:
        run = Run(config(faults=(Fault("kill", 1.0, "random"),), seed=seed))
        run.until(11)
        return run.signals[0].node

    chosen = [killed(seed) for seed in range(12)]
    assert chosen == [killed(seed) for seed in range(12)]
    assert set(chosen) == {1, 2, 3, 4}


def test_a_role_that_nobody_has_does_nothing() -> None:
    run = Run(config(faults=(Fault("kill", 1.0, "relay:mid"),)), status=lambda _: Status(nms=0, hops=1))
    run.until(12)
    assert run.signals == []
    assert "nobody is relay:mid" in run.faults[0].text
    assert run.world.final()["faults"] == []


def snapshot(nms: Mapping[int, int], searching: tuple[int, ...], dead: tuple[int, ...] = ()) -> Snapshot:
    n = max(nms)

    def hops(node: int) -> int:
        steps = 0
        while node > 0 and steps <= n:
            node, steps = nms[node], steps + 1
        return steps if node == 0 else UNREACHABLE

    nodes = np.arange(1, n + 1, dtype=np.int16)
    return Snapshot(
        5,
        nodes,
        np.array([k not in dead for k in range(1, n + 1)], np.uint8),
        np.column_stack((nodes.astype(float), np.zeros(n))),
        np.array([Cls.SR if k in searching else Cls.RR for k in range(1, n + 1)], np.uint8),
        np.zeros(n, np.uint8),
        np.array([hops(k) for k in range(1, n + 1)], np.uint8),
        np.array([nms[k] for k in range(1, n + 1)], np.int16),
        np.full(n, NOBODY, np.int16),
        np.zeros((n, 2)),
    )


def test_targets_by_role() -> None:
    tree = snapshot({1: 0, 2: 1, 3: 2, 4: 3, 5: 4, 6: 0, 7: 6}, searching=(5, 7))
    generator = np.random.default_rng(0)

    def who(target: str, shown: Snapshot = tree) -> int | None:
        return resolve(target, shown, (0.0, 0.0), generator)

    assert who("station") == 0
    assert who("3") == 3
    assert who("sr:far") == 5
    assert who("relay:first") == 1
    assert who("relay:mid") == 2
    assert who("nms-of:7") == 6
    assert who("nms-of:6") is None, "that would be the MS"
    assert who("nms-of:9") is None
    broken = snapshot({1: 0, 2: 1, 3: 2, 4: 3, 5: 4, 6: 0, 7: 6}, searching=(5, 7), dead=(3,))
    assert who("relay:mid", broken) == 6, "the longest chain that leads to the MS"
    loop = snapshot({1: 2, 2: 1}, searching=(1, 2))
    assert who("sr:far", loop) is None
    level = snapshot({1: 0, 2: 0, 3: 0}, searching=(1, 2, 3))
    assert who("sr:far", level) == 3, "of equal hops the farthest"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("kill:relay:mid@90", Fault("kill", 90.0, "relay:mid")),
        ("pause:4@60+5", Fault("pause", 60.0, "4", 5.0)),
        ("restart:station@60.5+0.5", Fault("restart", 60.5, "station", 0.5)),
        ("restart:nms-of:7@60+5", Fault("restart", 60.0, "nms-of:7", 5.0)),
        ("jam:3,4@50+10", Fault("jam", 50.0, "3,4", 10.0)),
        ("jam:10,10,20,20.5@50+10", Fault("jam", 50.0, "10,10,20,20.5", 10.0)),
        ("loss:0.3@50+10", Fault("loss", 50.0, "", 10.0, 0.3)),
        ("kill:random@0", Fault("kill", 0.0, "random")),
    ],
)
def test_faults_as_the_command_line_has_them(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault
    assert parse_fault(describe(fault)) == fault
    assert Fault(**fault_form(fault)) == fault


@pytest.mark.parametrize(
    "text",
    [
        "", "kill", "kill:4", "kill:@5", "kill:4@", "kill:4@x", "kill:4@5+2", "kill:0@5", "kill:-1@5", "kill:x@5",
        "kill:relay:last@5", "kill:nms-of:x@5", "pause:4@5", "restart:4@5+0", "restart:4@5+0.01", "kill:4@nan",
        "kill:4@-5", "jam:3@5+1", "jam:3,3@5+1", "jam:a,b@5+1", "jam:1,2,1,4@5+1", "jam:1,nan,3,4@5+1", "loss:2@5+1",
        "loss:0@5+1", "loss:x@5+1", "loss:nan@5+1", "shoot:4@5", "kill:4@5@6", "jam:0,1@1+1e308", "kill:4@1e300",
        "jam:0,0,1e9,1e9@5+5", "x" * 10**6, "kill:" + "1" * 5000 + "@5", "jam:1," + "2" * 5000 + "@5+1",
    ],
)  # fmt: skip
def test_bad_faults_are_one_clear_line(text: str) -> None:
    with pytest.raises(ValueError, match="fault '") as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_fault_against_the_run() -> None:
    check_fault(Fault("kill", 5.0, "9"), robots=9, duration_s=10.0)
    for fault in (Fault("kill", 5.0, "10"), Fault("kill", 10.0, "3"), Fault("jam", 5.0, "0,10", 1.0)):
        with pytest.raises(ValueError, match=r"only|within"):
            check_fault(fault, robots=9, duration_s=10.0)


def test_one_who_is_paused_takes_a_step_that_nobody_hears() -> None:
    run = Run(config(faults=(Fault("pause", 2.0, "2", 1.0), Fault("kill", 2.0, "3"))))
    run.until(25)
    begin = run.begun[20]
    assert list(begin.unheard) == [2]
    assert (begin.unheard[2].tick, begin.unheard[2].first) == (20, False)
    assert begin.positions.nodes.tolist() == [0, 1, 4]
    assert all(not other.unheard for other in run.begun if other is not begin)


def test_noise_does_not_depend_on_who_else_is_there() -> None:
    noisy = {"pose_noise_m": 0.1, "lidar": Lidar(noise_m=0.1)}
    alone, together = (Run(config(faults=faults, **noisy)) for faults in ((Fault("kill", 1.0, "1"),), ()))
    for run in (alone, together):
        run.until(30)
    for begin, other in zip(alone.begun, together.begun, strict=True):
        mine, theirs = begin.senses[3], other.senses[3]
        assert (mine.x_m, mine.y_m) == (theirs.x_m, theirs.y_m)
        assert (mine.ranges_m is None) == (theirs.ranges_m is None)
        if mine.ranges_m is not None and theirs.ranges_m is not None:
            assert mine.ranges_m.tobytes() == theirs.ranges_m.tobytes()


def test_a_verdict_is_told_as_soon_as_it_is_final() -> None:
    run = Run(config(faults=(Fault("pause", 2.0, "2", 1.0),)))
    for tick in range(40):
        run.tick(report=Report(tick, False, (0.0,), 0))
    (told,) = [event for end in run.ended for event in end.events if event.kind == "recovery"]
    assert told.tick == 30
    assert told.data == run.world.final()["recoveries"][0]
    assert told.text == "pause:2@2+1: cut off 3, 4; the last has a route again after 1 s"


# The account of a tick


def test_a_tick_may_be_told_of_when_the_next_has_begun() -> None:
    """Whatever happens in between, and as late as the caller likes."""
    faults = (
        Fault("pause", 1.0, "3", 0.2),
        Fault("restart", 6.5, "relay:first", 0.8),
        Fault("pause", 8.0, "relay:first", 0.5),
    )
    at_once, late, never = (Run(config(faults=faults)) for _ in range(3))
    told: dict[Run, list[Told]] = {at_once: [], late: []}
    for tick in range(100):
        for run in (at_once, late, never):
            world = run.world
            run.velocity = {2: (0.3, 0.1)}
            if tick == 0:
                run.status[4] = Status(nms=3, hops=4, target_x_m=1.0)
            if tick == 5:
                world.depart(4, "died", counted=False)  # which cuts nobody off
            if tick == 20:
                world.arrive(4, new=True)
            if tick in (21, 99):
                run.status[4] = Status()  # without a route, and that in no other tick
            if tick == 24:
                run.status[4] = Status(nms=2, hops=3)  # and not 3 any more
            if tick == 25:
                world.depart(3, "died", counted=False)
            if tick == 39 or 60 < tick < 99:
                first = 2 - tick % 2 if tick > 60 else 2  # another one is next to the MS in every tick
                run.status = {n: Status(nms=first, hops=2) for n in range(1, 5)} | {first: chain(1)}
            if tick == 40:
                world.inject(Fault("pause", 0.0, "relay:first", 0.3))
            for node in sorted(world.awaited()):
                world.arrive(node, new=True)
            run.begun.append(world.begin())
            if run is late and tick:
                told[run].append(world.tell())
            world.end(run.motions(), None)
            if run is at_once:
                told[run].append(world.tell())
    told[late].append(late.world.tell())
    now, then = told.values()
    assert [a.snapshot.encode() for a in now] == [b.snapshot.encode() for b in then]
    assert [a.events for a in now] == [b.events for b in then]
    assert sum(len(a.events) for a in now) > 8
    assert at_once.world.final() == late.world.final() == never.world.final()
    for begin, account in zip(late.begun, then, strict=True):
        places = dict(zip(begin.positions.nodes.tolist(), begin.positions.xy_m.tolist(), strict=True))
        robots = zip(account.snapshot.nodes.tolist(), account.snapshot.xy_m.tolist(), strict=True)
        assert all(places.get(node, place) == place for node, place in robots)


def test_faults_and_verdicts_are_told_in_the_order_of_their_ticks() -> None:
    """Also where a death that counts from the next tick is noticed first; a replay has them by their ticks, too."""
    run = Run(config(duration_s=2.0))
    run.until(4)
    run.begun.append(run.world.begin())
    run.world.depart(3, DIED, counted=True)
    run.world.depart(2, DIED, counted=False)
    run.end({node: motion for node, motion in run.motions().items() if node != 2})
    run.until(9)
    told = run.world.final()
    assert [(fault["target"], fault["at_s"]) for fault in told["faults"]] == [("2", 0.5), ("3", 0.6)]
    assert [verdict["fault"] for verdict in told["recoveries"]] == ["kill:2@0.5", "kill:3@0.6"]


def test_a_role_that_an_external_robot_has_is_nobodys() -> None:
    run = Run(config(external=(1, 2, 3, 4), faults=(Fault("kill", 2.0, "random"), Fault("loss", 3.0, "", 1.0, 0.5))))
    run.until(40)
    assert run.world.final()["faults"] == [{"verb": "loss", "at_s": 3.0, "for_s": 1.0, "probability": 0.5}]
    (told, _) = [event.text for event in run.faults]
    assert "kill:random@2" in told
    assert told.endswith("it is external, so that is up to whoever runs its process")
    with pytest.raises(ValueError, match="kill of robot 4: it is external"):
        run.world.inject(Fault("kill", 0.0, "4"))
