"""On which processor each process of a run stays."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from deploy.processes import processors
from deploy.processes.processors import assigned, shared
from deploy.processes.supervisor import Supervisor
from tests.processes.test_supervisor import PRELOAD

pytestmark = pytest.mark.processes

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
    assert assigned((2, 3), nodes) == stays
    assert assigned((), nodes) == {}
    assert set(assigned((7,), nodes).values()) == {7}
    many = assigned(range(4), [str(k) for k in range(101)])
    assert [list(many.values()).count(processor) for processor in range(4)] == [26, 25, 25, 27]


def test_processes_stay_where_they_belong_and_return_there(tmp_path: Path) -> None:
    with Supervisor("test", tmp_path, PRELOAD, processors={"a": ALLOWED[-1]}) as supervisor:
        for name in ("a", "b", "a"):
            supervisor.start(name, says_where)
            while supervisor.pids:
                supervisor.wait(5.0)
    assert (tmp_path / "a.log").read_text().split() == [str(ALLOWED[-1])] * 2
    assert (tmp_path / "b.log").read_text().split() == [str(processor) for processor in ALLOWED]
