"""The supervisor with trivial children: ends are reported, logs kept, and nothing survives the launcher."""

from __future__ import annotations

import multiprocessing.forkserver
import os
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.processes.supervisor import Exit, Supervisor
from deploy.run_folder.claim import Claim, ClaimError
from tests import ROOT
from tests.helpers.waiting import alive, wait_until

pytestmark = pytest.mark.processes

PRELOAD = ["numpy", "scipy.sparse.csgraph", "msgpack", "zenoh"]


def ends(words: str) -> None:
    print(words)


def fails() -> None:
    raise ValueError("the reason")


def prints_too_much() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    for _ in range(100):
        print("a policy that prints in every step")
        print("and complains", file=sys.stderr)


def complains_in_the_end() -> None:
    sys.exit("journal could not be written: no room")


def waits(ready: Path | None = None) -> None:
    if ready is not None:
        ready.touch()
    threading.Event().wait()


def refuses_to_end(ready: Path) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    ready.touch()
    threading.Event().wait()


def reports() -> None:
    title = Path("/proc/self/cmdline").read_bytes().split(b"\0")[0].decode()
    print("title", title)
    print("threads of the fork server", len(list(Path(f"/proc/{os.getppid()}/task").iterdir())))
    print("preloaded", *(name for name in PRELOAD if name in sys.modules))
    print("SIGINT ignored", signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
    print("OMP", os.environ["OMP_NUM_THREADS"])


@pytest.fixture
def supervisor(tmp_path: Path) -> Iterator[Supervisor]:
    # Python keeps one fork server, with the modules and the environment of whichever test started it.
    multiprocessing.forkserver._forkserver._stop()
    with Supervisor("test", tmp_path / "logs", PRELOAD) as running:
        yield running
        pids = list(running.pids.values())
    assert not [pid for pid in pids if alive(pid)]


def wait_for_end(supervisor: Supervisor) -> Exit:
    while not (found := supervisor.wait()):
        pass
    return found[0]


def test_a_normal_end_has_status_0_and_leaves_a_log(supervisor: Supervisor) -> None:
    pid = supervisor.start("robot/4", ends, "some words")
    assert wait_for_end(supervisor) == Exit("robot/4", pid, 0)
    assert supervisor.tail("robot/4") == "some words"
    assert not supervisor.pids


def test_an_exception_is_told_from_a_signal(supervisor: Supervisor) -> None:
    supervisor.start("robot/1", fails)
    end = wait_for_end(supervisor)
    assert (end.code, end.by_signal) == (1, False)
    assert supervisor.tail("robot/1", 1) == "ValueError: the reason"

    pid = supervisor.start("robot/1", waits)
    os.kill(pid, signal.SIGKILL)
    end = wait_for_end(supervisor)
    assert (end.code, end.by_signal) == (-signal.SIGKILL, True)
    assert str(end) == f"robot/1 (pid {pid}) ended by SIGKILL"
    assert "the reason" in supervisor.tail("robot/1"), "the log of a name goes on after a restart"


def test_a_log_that_is_full_ends_nobody_and_is_told(supervisor: Supervisor) -> None:
    pid = supervisor.start("robot/1", prints_too_much)
    words = "logs/robot-1.log could not be written: File too large"
    assert wait_for_end(supervisor) == Exit("robot/1", pid, 0, words)
    assert supervisor.tail("robot/1", 1).startswith("a policy that")


def test_the_message_of_an_end_is_handed_on_though_no_disk_takes_it(supervisor: Supervisor) -> None:
    pid = supervisor.start("station", complains_in_the_end)
    assert wait_for_end(supervisor) == Exit("station", pid, 0, "journal could not be written: no room")
    supervisor.log_path("robot/1").mkdir()
    pid = supervisor.start("robot/1", ends, "unheard")
    words = "logs/robot-1.log could not be written: Is a directory"
    assert wait_for_end(supervisor) == Exit("robot/1", pid, 0, words)


def test_an_end_by_a_signal_without_a_name_is_told() -> None:
    assert str(Exit("robot/4", 17, -int(signal.SIGKILL))) == "robot/4 (pid 17) ended by SIGKILL"
    assert str(Exit("robot/4", 17, -(signal.SIGRTMIN + 1))) == f"robot/4 (pid 17) ended by signal {signal.SIGRTMIN + 1}"


def test_children_are_titled_preloaded_and_single_threaded(supervisor: Supervisor) -> None:
    supervisor.start("robot/7", reports)
    assert wait_for_end(supervisor).code == 0
    told = dict(line.rsplit(" ", 1) for line in supervisor.tail("robot/7").splitlines() if "preloaded" not in line)
    assert "title vds robot/7 test" in supervisor.tail("robot/7")
    assert told["threads of the fork server"] == "1", "a preloaded module started a thread"
    assert told["SIGINT ignored"] == "True"
    assert told["OMP"] == "1"
    assert f"preloaded {' '.join(PRELOAD)}" in supervisor.tail("robot/7")


def test_wake_interrupts_a_wait_from_another_thread(supervisor: Supervisor) -> None:
    timer = threading.Timer(0.05, supervisor.wake)
    timer.start()
    assert supervisor.wait() == []
    timer.join()


def test_stop_ends_a_stopped_process_at_once_and_a_stubborn_one_after_the_grace(
    supervisor: Supervisor, tmp_path: Path
) -> None:
    stopped = supervisor.start("stopped", waits, tmp_path / "stopped")
    stubborn = supervisor.start("stubborn", refuses_to_end, tmp_path / "stubborn")
    wait_until((tmp_path / "stopped").exists, "started")
    wait_until((tmp_path / "stubborn").exists, "started")
    assert supervisor.signal("stopped", signal.SIGSTOP)
    codes = {end.name: end.code for end in supervisor.stop(grace_s=0.5)}
    assert codes == {"stopped": -signal.SIGTERM, "stubborn": -signal.SIGKILL}
    assert not alive(stopped)
    assert not alive(stubborn)
    assert not supervisor.signal("stopped", signal.SIGCONT), "there is nobody to signal"


def test_a_name_is_used_once_at_a_time(supervisor: Supervisor) -> None:
    pid = supervisor.start("robot/1", waits)
    with pytest.raises(ValueError, match="alive"):
        supervisor.start("robot/1", waits)
    assert supervisor.end("robot/1") == Exit("robot/1", pid, -signal.SIGKILL)
    assert supervisor.start("robot/1", waits) != pid


def test_a_killed_fork_server_leaves_no_process_either(supervisor: Supervisor, tmp_path: Path) -> None:
    pid = supervisor.start("robot/1", waits, tmp_path / "ready")
    wait_until((tmp_path / "ready").exists, "started")
    fork_server = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    os.kill(fork_server, signal.SIGKILL)
    assert wait_for_end(supervisor) == Exit("robot/1", pid, 255)
    wait_until(lambda: not alive(pid), "the child is gone")


LAUNCHER = """
import signal, sys
from pathlib import Path
from deploy.processes.supervisor import Supervisor
from deploy.run_folder.claim import Claim
import tests.processes.test_supervisor as children

if __name__ == "__main__":
    here = Path(sys.argv[1])
    with Supervisor("orphans", here / "logs", held=Claim(here / "run").lock) as supervisor:
        pids = [supervisor.start(name, children.waits, here / name) for name in ("running", "stopped")]
        pids.append(supervisor.start("stubborn", children.refuses_to_end, here / "stubborn"))
        while not all((here / name).exists() for name in ("running", "stopped", "stubborn")):
            supervisor.wait(0.01)
        supervisor.signal("stopped", signal.SIGSTOP)
        print(*pids, flush=True)
        supervisor.wait()
"""


def test_no_process_survives_a_killed_launcher(tmp_path: Path) -> None:
    """A stopped one and one that ignores SIGTERM end, too."""
    script = tmp_path / "launcher.py"
    script.write_text(LAUNCHER)
    environment = dict(os.environ, PYTHONPATH=str(ROOT))
    command = [sys.executable, str(script), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as launcher:
        assert launcher.stdout is not None
        pids = [int(word) for word in launcher.stdout.readline().split()]
        assert len(pids) == 3
        launcher.kill()
    with pytest.raises(ClaimError, match="under way"):
        Claim(tmp_path / "run")  # who ignores SIGTERM has three seconds
    wait_until(lambda: not any(alive(pid) for pid in pids), "all children gone")
    Claim(tmp_path / "run").release()
    assert "the launcher is gone" in (tmp_path / "logs" / "running.log").read_text()
