"""Who runs on which processor, and what keeps those awake."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, alive, wait_until
from test_supervisor import PRELOAD

from deploy import processors
from deploy.processors import Vigil, places, shared
from deploy.supervisor import Supervisor

pytestmark = pytest.mark.processes

# The first to start the fork server of a session decides what it imports.
multiprocessing.set_forkserver_preload(PRELOAD)

ALLOWED = tuple(sorted(os.sched_getaffinity(0)))


def says_where() -> None:
    print(*sorted(os.sched_getaffinity(0)))


def test_processors_are_shared_only_by_more_processes_than_there_are() -> None:
    assert shared(len(ALLOWED)) == ()
    assert shared(len(ALLOWED) + 1) == ALLOWED


def test_only_processors_that_this_process_may_use_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5, 3})
    assert shared(12) == (3, 5)
    monkeypatch.setattr(processors.sys, "platform", "darwin")
    assert shared(12) == ()


def test_turns_begin_where_the_medium_is_not() -> None:
    nodes = [f"n{k}" for k in range(6)]
    stays = {"n0": 3, "n1": 3, "n2": 3, "n3": 2, "n4": 2, "n5": 2, "medium": 2, "world": 3}
    assert places((2, 3), nodes) == stays
    assert places((), nodes) == {}
    assert set(places((7,), nodes).values()) == {7}
    many = places(range(4), [str(k) for k in range(101)])
    assert [list(many.values()).count(processor) for processor in range(4)] == [26, 25, 25, 27]


def test_processes_stay_where_they_belong_and_return_there(tmp_path: Path) -> None:
    with Supervisor("test", tmp_path, PRELOAD, places={"a": ALLOWED[-1]}) as supervisor:
        for name in ("a", "b", "a"):
            supervisor.start(name, says_where)
            while supervisor.pids:
                supervisor.wait(5.0)
    assert (tmp_path / "a.log").read_text().split() == [str(ALLOWED[-1])] * 2
    assert (tmp_path / "b.log").read_text().split() == [str(processor) for processor in ALLOWED]


def scheduling(pid: int) -> tuple[str, int]:
    """State (R runs, S sleeps) and scheduling policy."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return fields[0], int(fields[38])


def test_a_vigil_spins_at_idle_priority_while_there_are_signs_of_life() -> None:
    with Vigil(ALLOWED, "test") as vigil:
        pids = vigil.pids
        assert len(pids) == len(ALLOWED)

        def signed() -> bool:
            vigil.sign()
            return all(scheduling(pid) == ("R", os.SCHED_IDLE) for pid in pids)

        wait_until(signed, 20, "all spin")
        wait_until(lambda: all(scheduling(pid)[0] == "S" for pid in pids), 20, "all sleep again")
        wait_until(signed, 20, "all spin again")
    assert not any(alive(pid) for pid in pids)
    vigil.sign()  # a late one is nobody's


def test_signs_never_make_their_giver_wait() -> None:
    with Vigil(ALLOWED[:1], "test") as vigil:
        for _ in range(100_000):  # more than a pipe holds
            vigil.sign()


OWNER = """
import sys
from deploy.processors import Vigil

if __name__ == "__main__":
    with Vigil((int(sys.argv[1]),), "test") as vigil:
        vigil.sign()
        print(*vigil.pids, flush=True)
        sys.stdin.read()
"""


def test_a_vigil_ends_with_its_owner(tmp_path: Path) -> None:
    script = tmp_path / "owner.py"
    script.write_text(OWNER)
    command = [sys.executable, str(script), str(ALLOWED[0])]
    environment = dict(os.environ, PYTHONPATH=str(ROOT))
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as owner:
        assert owner.stdout is not None
        pid = int(owner.stdout.readline())
        assert alive(pid)
        owner.kill()
    wait_until(lambda: not alive(pid), 10, "the spinning process is gone")
