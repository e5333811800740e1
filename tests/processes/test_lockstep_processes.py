"""Death, hang, return and the loss of world and medium, with real processes and real Zenoh."""

from __future__ import annotations

import json
import signal
import time

import pytest

from bus.member import LOST_STATUS, REFUSED_STATUS, Member
from medium.messages import Inbox, Transmission
from tests.helpers.small_run import BROKEN, BadSpeaker, small_run
from world.messages import Motion, Sense, Status

pytestmark = pytest.mark.processes


def test_runs_to_its_time_limit_and_everybody_leaves() -> None:
    with small_run(duration_s=10.0) as run:
        run.until(lambda: len(run.finals) == 3, "the final counts")
        assert run.finals["world"]["status"] == "time_limit"
        assert run.finals["world"]["ticks"] == 100
        # Everybody hears everybody: 4 nodes, each frame reaches 3.
        assert run.finals["medium"]["frames"]["sent"] == 400
        assert run.finals["medium"]["frames"]["delivered"] == 1200
        assert run.finals["station"]["spoke"]
        assert abs(sum(run.finals["world"]["tick_blame"].values()) - 1.0) < 0.01
        assert [s.tick for s in run.snapshots] == list(range(100))
        assert run.exit_codes(*run.processes) == [0] * 6


def test_killed_robot_is_left_out_and_its_new_process_joins() -> None:
    with small_run() as run:
        run.signal("robot-2", signal.SIGKILL)
        run.until(lambda: not run.present(2), "robot 2 departed")
        before = run.tick
        run.ticks(30)
        assert run.present(1)
        assert run.present(3)
        run.start_robot(2, "robot-2-again")
        run.until(lambda: run.present(2), "robot 2 back")
        run.ticks(20)
        run.interrupt()
        final = run.finals["world"]
        assert final["status"] == "interrupted"
        assert final["ticks"] > before + 50
        assert final["wall_clock_faults"] == 1
        (fault,) = final["faults"]
        assert "restart" in json.dumps(fault)
        assert run.exit_codes("robot-1", "robot-2-again", "robot-3", "station", "world", "medium") == [0] * 6


def test_stopped_robot_is_departed_and_joins_again_when_it_thaws() -> None:
    with small_run(hang_deadline_s=2.0) as run:
        run.signal("robot-3", signal.SIGSTOP)
        run.until(lambda: not run.present(3), "robot 3 departed")
        run.ticks(30)
        assert not run.present(3)
        run.signal("robot-3", signal.SIGCONT)
        run.until(lambda: run.present(3), "robot 3 back")
        run.ticks(20)
        run.interrupt()
        (fault,) = run.finals["world"]["faults"]
        assert "pause" in json.dumps(fault)
        assert run.exit_codes("robot-3", "world", "medium") == [0, 0, 0]


def test_new_process_replaces_a_hung_one_which_is_refused_when_it_thaws() -> None:
    with small_run(hang_deadline_s=2.0) as run:
        run.signal("robot-1", signal.SIGSTOP)
        run.until(lambda: not run.present(1), "robot 1 departed")
        run.start_robot(1, "robot-1-again")
        run.until(lambda: run.present(1), "robot 1 back")
        run.signal("robot-1", signal.SIGCONT)
        assert run.exit_codes("robot-1") == [REFUSED_STATUS]
        run.ticks(20)
        assert run.present(1)


def test_second_living_process_of_a_robot_is_refused() -> None:
    with small_run() as run:
        run.start_robot(2, "impostor")
        assert run.exit_codes("impostor") == [REFUSED_STATUS]
        assert "already robot 2" in run.log("impostor")
        run.ticks(20)
        assert run.present(2)
        assert any("refused" in event.text for event in run.events)


def test_killed_station_is_left_out_and_its_journal_is_read_again() -> None:
    with small_run() as run:
        run.signal("station", signal.SIGKILL)
        run.ticks(30)
        run.processes["station"].join()
        size = (run.folder / "journal").stat().st_size
        assert size > 0
        run.start_station("station-again")
        run.until(lambda: (run.folder / "journal").stat().st_size > size, "the journal grows again")


@pytest.mark.parametrize("victim", ["medium", "world"])
def test_everybody_ends_when_world_or_medium_dies(victim: str) -> None:
    with small_run() as run:
        others = [name for name in run.processes if name != victim]
        run.signal(victim, signal.SIGKILL)
        codes = dict(zip(others, run.exit_codes(*others), strict=True))
        if victim == "medium":
            # The world outlives the medium for long enough to end the run as failed.
            assert codes.pop("world") in (0, LOST_STATUS)
        assert set(codes.values()) == {LOST_STATUS}
        last = run.log("robot-1").splitlines()[-1]
        assert "gone: this process ends" in last


def test_silent_medium_ends_the_run_as_failed() -> None:
    with small_run(medium_deadline_s=3.0) as run:
        run.signal("medium", signal.SIGSTOP)
        run.until(lambda: "medium was silent" in run.log("world"), "the world's verdict")
        run.signal("medium", signal.SIGCONT)
        run.until(lambda: "world" in run.finals, "the final counts")
        assert run.finals["world"]["status"] == "failed"
        assert "medium was silent" in run.finals["world"]["why"]
        assert run.exit_codes("robot-1", "station", "world", "medium") == [0] * 4


def test_who_never_comes_is_named() -> None:
    with small_run(absent=2, return_deadline_s=1.0) as run:
        run.until(lambda: "world" in run.finals, "the end")
        assert run.finals["world"]["status"] == "failed"
        before, _, absent = run.finals["world"]["why"].partition(": ")
        assert before == "not there within 1 s"
        assert "robot 2" in absent.split(", "), "a busy machine may keep others away for as long"


def test_speed_and_hold_are_obeyed() -> None:
    with small_run(speed=20.0) as run:
        start, since_s = run.tick, time.monotonic()
        run.ticks(100)
        # 100 ticks are 10 s of simulated time; the feed comes in batches of 10 ticks.
        assert time.monotonic() - since_s > (run.tick - start - 20) * 0.1 / 20.0
        assert json.loads(run.command("hold"))["held"]
        run.until(lambda: not json.loads(run.command("status"))["ticking"], "the end of the tick")
        held = json.loads(run.command("status"))["tick"]
        assert json.loads(run.command("step 5"))["held"]
        run.until(lambda: json.loads(run.command("status"))["tick"] == held + 5, "five steps")
        assert "error" in json.loads(run.command("speed fast"))
        assert json.loads(run.command("speed max"))["speed"] == "max"
        run.ticks(50)
        run.interrupt()
        assert run.finals["world"]["status"] == "interrupted"


def test_robot_that_raises_ends_with_its_traceback_and_the_run_goes_on() -> None:
    with small_run() as run:
        run.signal("robot-2", signal.SIGKILL)
        run.until(lambda: not run.present(2), "robot 2 departed")
        run.cores = {2: BadSpeaker}
        run.start_robot(2, "bad")
        assert run.exit_codes("bad") == [1]
        assert "ZeroDivisionError: at tick" in run.log("bad")
        run.ticks(20)
        assert not run.present(2)


def test_world_that_raises_takes_everybody_with_it() -> None:
    with small_run(seed=BROKEN) as run:
        codes = dict(zip(run.processes, run.exit_codes(*run.processes), strict=True))
        assert codes.pop("world") == 1
        assert "ZeroDivisionError" in run.log("world")
        assert set(codes.values()) == {LOST_STATUS}


def test_nonsense_counts_for_nothing_until_a_whole_answer_comes_or_the_deadline() -> None:
    with small_run(absent=3, hang_deadline_s=2.0) as run:
        member = Member(run.logins["robot-3"], "robot", 3, Sense.decode, Inbox.decode)
        with member:
            stray = member.session._session.liveliness().declare_token("vds/small/alive/robot/3/1/nonsense")
            for k in range(30):
                turn = member.turn()
                assert turn is not None
                tick = turn[0].tick
                standing = Motion(tick, 0.0, 0.0, Status()).encode()
                speeches = (
                    b"nonsense",
                    Transmission(tick, 1, ()).encode(),
                    Transmission(tick + 9, 3, ()).encode(),
                    Transmission(max(tick - 1, 0), 1, ()).encode(),
                )
                member.answer(tick, speeches[k % 4], standing)
                if k < 29:
                    member.answer(tick, Transmission(tick, 3, ()).encode(), standing)
            run.until(lambda: run.tick >= 29 and not run.present(3), "robot 3 departed")
            run.ticks(10)
            run.interrupt()
            stray.undeclare()
        assert next(s.tick for s in run.snapshots if not s.present[2]) == 29
        assert run.finals["medium"]["malformed"] == 31, "what robot 3 said, and the token"
        assert run.finals["world"]["malformed"] == 1, "the token"
        assert run.finals["world"]["status"] == "interrupted"


def test_fault_by_hand_takes_a_robot_out_and_tells_the_launcher() -> None:
    with small_run() as run:
        assert "error" in json.loads(run.command("fault kill:7@0"))
        assert "error" not in json.loads(run.command("fault pause:2@0+3"))
        run.until(lambda: not run.present(2), "robot 2 paused")
        run.until(lambda: run.present(2), "robot 2 back")
        assert json.loads(run.command("status"))["robots"] == [1, 2, 3]
        assert [(order.node, order.verb) for order in run.signals] == [(2, "stop"), (2, "cont")]
