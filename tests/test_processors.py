"""Who runs on which processor, and what keeps those awake."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, alive, wait_until

from deploy import processors
from deploy.processors import Vigil, shared
from deploy.supervisor import Supervisor

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


def test_processes_take_the_processors_by_turns_and_keep_theirs_when_they_return(tmp_path: Path) -> None:
    two = (ALLOWED * 2)[:2]
    with Supervisor("test", tmp_path, processors=two) as supervisor:
        for name in ("a", "b", "c", "b"):  # b is started again when it has ended
            supervisor.start(name, says_where)
            while supervisor.pids:
                supervisor.wait(5.0)
    assert (tmp_path / "a.log").read_text().split() == [str(two[0])]
    assert (tmp_path / "b.log").read_text().split() == [str(two[1])] * 2
    assert (tmp_path / "c.log").read_text().split() == [str(two[0])]


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
