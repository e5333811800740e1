"""Orders branches of a run, and takes their answers; the runs themselves are in processes (`trunk.py`)."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Generator, Sequence
from typing import IO, Any, Final

from bus.excerpt import shown
from deploy.branching.trunk import LENGTH, Branch, Order, run_to_the_end
from deploy.scenario import Scenario, ScenarioError, with_changes
from deploy.simulation import Result
from world.faults import describe
from world.terms import tick_of

__all__ = ["BranchError", "answers", "branch"]

_TRUNK: Final = """
import json, sys
sys.path[:] = json.loads(sys.argv.pop())
from deploy.machine.limits import one_thread
one_thread()
from deploy.branching.trunk import main
main()
"""
"""Of a fresh interpreter that finds modules where this one does, a user's policies too."""


class BranchError(Exception):
    """A branch that has no result; one line for the user."""


def branch(
    scenario: Scenario, at_s: float, changes: Sequence[Sequence[Any]], *, at_once: int | None = None
) -> list[Result]:
    """Run a scenario to a moment once, and go on from there with each of several futures.

    A result, its digest too, is that of a run of the scenario with these faults and changes from the start.

    Args:
        scenario: of the common past.
        at_s: the moment, in simulated seconds: what it changes acts at this tick or later.
        changes: for each branch what is added to the faults and changes of the scenario: texts in the form of the
            command line ("kill:4@60"), tables as in [[fault]] and [[change]], `Fault`, or `Change`. None of them gives
            the run as it is.
        at_once: most branches under way; None: one per core.

    Raises:
        ScenarioError: a fault or a change is wrong, or acts before `at_s`; one line.
        BranchError: a branch did not come to its end, as by an exception of a policy.
    """
    tick = tick_of(at_s)
    branches = [Branch(str(i), tick, _future(scenario, at_s, more)) for i, more in enumerate(changes)]
    order = Order(scenario, branches, run_to_the_end, at_once or os.cpu_count() or 1, keeps=True)
    told = dict(answers(order))
    for answer in told.values():
        if isinstance(answer, BranchError):
            raise answer
    return [Result(*told[each.key]) for each in branches]


def _future(scenario: Scenario, at_s: float, more: Sequence[Any]) -> Scenario:
    future = with_changes(scenario, more)
    own = scenario.tables
    for fault in future.tables.fault[len(own.fault) :]:
        if tick_of(fault.at_s) < tick_of(at_s):
            raise ScenarioError(f"fault '{shown(describe(fault))}' acts before the branch at at_s = {at_s:g}")
    for change in future.tables.change[len(own.change) :]:
        if tick_of(change.at_s) < tick_of(at_s):
            raise ScenarioError(f"a change at at_s = {change.at_s:g} acts before the branch at at_s = {at_s:g}")
    return future


def answers(order: Order) -> Generator[tuple[str, Any], None, None]:
    """The key of each branch and what its task returned, as they end. Closing the iterator ends what is under way.

    In place of what it returned there is a `BranchError` where a task did not come to its end.

    Raises:
        BranchError: the process that runs the common past did not come to its end.
    """
    orders_in, orders_out = os.pipe()
    answers_in, answers_out = os.pipe()
    with os.fdopen(answers_in, "rb") as incoming, os.fdopen(orders_out, "wb", buffering=0) as outgoing:
        trunk = subprocess.Popen(
            [sys.executable, "-c", _TRUNK, str(orders_in), str(answers_out), json.dumps(sys.path)],
            pass_fds=(orders_in, answers_out), stdin=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            os.close(orders_in)
            os.close(answers_out)
            _write(outgoing, pickle.dumps(order))
            for _ in order.branches:
                yield _next(incoming, trunk)
        finally:
            trunk.kill()
            trunk.wait()


def _write(outgoing: IO[bytes], packed: bytes) -> None:
    left = memoryview(LENGTH.pack(len(packed)) + packed)
    with contextlib.suppress(BrokenPipeError):  # who waits for an answer tells that it ended
        while left:
            left = left[outgoing.write(left) :]


def _next(incoming: IO[bytes], trunk: subprocess.Popen[bytes]) -> tuple[str, Any]:
    head = incoming.read(LENGTH.size)
    body = incoming.read(LENGTH.unpack(head)[0]) if len(head) == LENGTH.size else b""
    if not body:
        raise BranchError(f"the process that runs the past of the branches ended (status {trunk.wait():d})")
    key, told = pickle.loads(body)
    whole, answer = pickle.loads(told)
    if whole:
        return key, answer
    if not key:
        raise BranchError(f"the past of the branches: {shown(answer, 300)}")
    return key, BranchError(f"branch {key}: {shown(answer, 300)}")
