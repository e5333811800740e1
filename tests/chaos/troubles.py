"""Every kind of trouble: a function that starts a run, makes the trouble, and says how the run has to end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from bus.nodes import process_name
from tests import ROOT
from tests.chaos.ending import AS_ASKED, IN_ORDER, LOST, UNWRITTEN, Expected
from tests.chaos.open_run import LOGINS
from tests.chaos.rogue import ACTS
from tests.chaos.short_run import MOMENTS, ShortRun
from tests.chaos.small_disk import limited

__all__ = ["KINDS", "Trouble"]

Trouble = Callable[[ShortRun], Expected]

FULL: Final = "No space left on device"
TOO_LARGE: Final = "File too large"


# Processes of a run


def robots_die(run: ShortRun) -> Expected:
    """Some robots, though not all, at one moment."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    for node in run.draw.sample(range(1, run.robots + 1), run.draw.randint(1, run.robots - 1)):
        run.strike(process_name(node), signal.SIGKILL)
    return Expected(AS_ASKED)


def all_robots_die(run: ShortRun) -> Expected:
    """One after the other; the run then ends at once."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    for node in run.draw.sample(range(1, run.robots + 1), run.robots):
        run.strike(process_name(node), signal.SIGKILL)
    gone = {1: ("no_robots",)}
    return Expected({**gone, **AS_ASKED} if run.moment == "at the end" else gone)


def robots_freeze(run: ShortRun) -> Expected:
    """Some robots, for a moment or for longer than is allowed; one that is not continued is so by the launcher."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    names = [process_name(node) for node in run.draw.sample(range(1, run.robots + 1), run.draw.randint(1, 2))]
    for name in names:
        run.strike(name, signal.SIGSTOP)
    run.wait(run.draw.choice((0.05, 0.5, 3.0)))
    for name in names[run.draw.randint(0, 1) :]:
        run.strike(name, signal.SIGCONT)
    return Expected(AS_ASKED)


def station_dies(run: ShortRun) -> Expected:
    """Once or twice; it is started again."""
    run.begin()
    for moment in sorted(run.draw.sample(MOMENTS, run.draw.randint(1, 2)), key=MOMENTS.index):
        run.reach(moment)
        run.strike("station", signal.SIGKILL)
    return Expected(AS_ASKED)


def nodes_die_and_freeze(run: ShortRun) -> Expected:
    """Robots and station, again and again, robot 1 excepted."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS[:-1]))
    for _ in range(run.draw.randint(2, 5)):
        name = run.draw.choice(["station", *map(process_name, range(2, run.robots + 1))])
        number = run.draw.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP))
        if run.strike(name, number) and number == signal.SIGSTOP and run.draw.random() < 0.7:
            run.wait(run.draw.choice((0.05, 0.5, 2.5)))
            run.strike(name, signal.SIGCONT)
        run.wait(run.draw.uniform(0.0, 0.6))
    return Expected(AS_ASKED)


def medium_dies(run: ShortRun) -> Expected:
    """The run can't go on, and says so."""
    return _core_dies(run, "medium")


def world_dies(run: ShortRun) -> Expected:
    """The run can't go on, and says so."""
    return _core_dies(run, "world")


def _core_dies(run: ShortRun, name: str) -> Expected:
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    run.strike(name, signal.SIGKILL)
    return Expected({**LOST, **AS_ASKED} if run.moment == "at the end" else LOST)


def core_stands_still(run: ShortRun) -> Expected:
    """Medium, world or launcher for a while: everything waits, and nobody is left out for it."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    name = run.draw.choice(("medium", "world", "launcher"))
    run.strike(name, signal.SIGSTOP)
    run.wait(run.draw.choice((0.1, 1.0, 2.5)))
    run.strike(name, signal.SIGCONT)
    return Expected(AS_ASKED)


def launcher_dies(run: ShortRun) -> Expected:
    """Then nobody writes a summary, but nothing stays."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    killed: Mapping[int, tuple[str, ...]] = {-signal.SIGKILL: ()}
    return Expected(killed if run.strike("launcher", signal.SIGKILL) else AS_ASKED)


def user_interrupts(run: ShortRun) -> Expected:
    """By Ctrl-C, `kill` or hanging up: to the launcher or to the whole process group, once or again and again."""
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    number = run.draw.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    send = run.draw.choice((os.kill, os.killpg))
    times = run.draw.choice((1, 1, 2, 6))
    for _ in range(times):
        with contextlib.suppress(ProcessLookupError):
            send(run.process.pid, number)
            run.acted = True
        run.wait(run.draw.choice((0.0, 0.02, 0.3)))
    # Who asks again wants the end now: nobody waits for the last counts then.
    return Expected(IN_ORDER, digest=times == 1)


# Strangers


def rogue_floods(run: ShortRun) -> Expected:
    """A client in the name of a robot sends without end."""
    return _rogue(run, "floods")


def rogue_freezes(run: ShortRun) -> Expected:
    """A client in the name of a robot listens, and stands still."""
    return _rogue(run, "freezes")


def rogue_talks_nonsense(run: ShortRun) -> Expected:
    """A client in the name of a robot sends what is no message."""
    return _rogue(run, "talks_nonsense")


def rogue_poses(run: ShortRun) -> Expected:
    """A client passes for a new process of a robot that is there."""
    return _rogue(run, "poses")


def _rogue(run: ShortRun, act: str) -> Expected:
    assert act in ACTS
    logins = run.out.parent / "logins.json"
    node, seed = run.draw.randint(1, run.robots), run.draw.getrandbits(32)
    command = [sys.executable, "-m", "tests.chaos.rogue", str(logins), str(node), str(seed), act]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as rogue:
        assert rogue.stdin is not None
        assert rogue.stdout is not None
        run.begin(program=("-m", "tests.chaos.open_run"), environment={LOGINS: str(logins), "PYTHONPATH": str(ROOT)})
        run.reach(run.draw.choice(MOMENTS[:-1]))
        run.wait_until(logins.exists)
        rogue.stdin.write(b"now\n")
        rogue.stdin.flush()
        run.wait(60.0)
        rogue.kill()
        run.acted = b"logged in" in rogue.stdout.read()
    name = process_name(node)
    ends: Mapping[int, Sequence[str]] = AS_ASKED
    if run.moment in MOMENTS[:3] and act in ("freezes", "poses"):
        # Who comes first is the robot: its own process is refused, and that is a failure.
        ends = {**ends, 1: AS_ASKED[0]}
    refused = rf"{name} \(pid \d+\) exited with status 4\n.*refused: another living process.*"
    return Expected(ends, faulty=frozenset({name}), honest=False, failures=refused)


# Disks and streams


def disk_is_small(run: ShortRun) -> Expected:
    """It fills up with what the run itself writes."""
    kilobytes = run.draw.choice((4, 8, 20, 40, 80, 160, 320, 1000))
    if _on_own_disk(run):
        _remount(run, kilobytes)
        run.begin()
        run.acted = True
        return _full(FULL)
    run.begin(first=limited(kilobytes))
    run.acted = True
    return _full(TOO_LARGE)


def disk_fills_up(run: ShortRun) -> Expected:
    """Somebody else fills it up, and perhaps makes room again."""
    if not _on_own_disk(run):
        return disk_is_small(run)
    _remount(run, 4000)
    run.begin()
    run.reach(run.draw.choice(MOMENTS))
    run.acted = not run.over
    ballast = run.out.parent / "ballast"
    with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    if run.draw.random() < 0.3:
        run.wait(run.draw.uniform(0.1, 1.5))
        ballast.unlink()
    return _full(FULL)


def file_is_limited(run: ShortRun) -> Expected:
    """By `ulimit -f`."""
    run.begin(first=limited(run.draw.choice((1, 4, 8, 20, 40, 80, 200))))
    run.acted = True
    return _full(TOO_LARGE)


def _full(why: str) -> Expected:
    return Expected({0: AS_ASKED[0], 1: AS_ASKED[0], 2: ()}, failures=f".*{UNWRITTEN}{why}")


def _on_own_disk(run: ShortRun) -> bool:
    return os.path.ismount(run.out.parent)


def _remount(run: ShortRun, kilobytes: int) -> None:
    words = ["mount", "-o", f"remount,size={kilobytes}k", str(run.out.parent)]
    subprocess.run(words, check=True, capture_output=True)


def reader_goes_away(run: ShortRun) -> Expected:
    """As `| head -1` does, from standard output or from both."""
    reader, writer = os.pipe()
    run.begin(stdout=writer, stderr=run.draw.choice((None, writer)))
    os.close(writer)
    if run.draw.random() < 0.7:
        os.read(reader, 1)
    os.close(reader)
    run.acted = not run.over
    return Expected(AS_ASKED)


def terminal_goes_away(run: ShortRun) -> Expected:
    """One that does not control the run, so that nobody sends a signal; or one that does."""
    terminal, own = os.openpty()
    controls = run.draw.random() < 0.5
    run.begin(stdout=own, stderr=own, first=(lambda: os.login_tty(own)) if controls else None)
    os.close(own)
    run.reach(run.draw.choice(MOMENTS))
    os.close(terminal)
    run.acted = not run.over
    return Expected(IN_ORDER if controls else AS_ASKED)


def disk_behind_output_is_full(run: ShortRun) -> Expected:
    """It costs the exit status, since somebody may miss those lines."""
    with Path("/dev/full").open("wb") as full:
        run.begin(stdout=full.fileno())
    run.acted = True
    return Expected({1: AS_ASKED[0]}, failures="none")


KINDS: Final[Mapping[str, Trouble]] = {
    trouble.__name__: trouble
    for trouble in (
        robots_die, rogue_floods, station_dies, disk_is_small, user_interrupts, all_robots_die, rogue_freezes,
        medium_dies, disk_fills_up, robots_freeze, reader_goes_away, launcher_dies, rogue_talks_nonsense,
        nodes_die_and_freeze, world_dies, file_is_limited, core_stands_still, rogue_poses, terminal_goes_away,
        disk_behind_output_is_full,
    )
}  # fmt: skip
