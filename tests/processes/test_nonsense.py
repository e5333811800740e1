"""A stranger with a robot's login who sends some nonsense, too little for a flood: the run goes on, and counts it."""

from __future__ import annotations

import random

import pytest

from bus.envelopes import Answer
from bus.lockstep import Kind, seal
from bus.session import Session
from tests.fuzzing.mutations import mutated
from tests.helpers.small_run import small_run

pytestmark = pytest.mark.processes

NESTED = b"\x91" * 1000 + b"\x01"


def test_a_run_goes_on_whatever_comes_on_the_key_of_a_robot() -> None:
    rng = random.Random(1)
    with small_run(3) as run, Session.connect(run.logins["robot-2"]) as stranger:
        put = stranger.publisher(stranger.keys.tx(2), blocking=True)
        honest = seal(Kind.DATA, 7, Answer(run.tick, b"\x93\x05\x02\x90", b"motion").encode())
        nonsense = [b"", NESTED, b"\x93" + 3 * NESTED, honest, *(mutated(rng, honest, [honest]) for _ in range(20))]
        for data in nonsense:
            put(data)
            put(seal(Kind.DATA, 7, data))
            put(seal(Kind.DATA, 7, Answer(run.tick + 1, b"\x93" + 3 * NESTED, data).encode()))
        run.ticks(50)
        assert [run.present(node) for node in (1, 2, 3)] == [True] * 3
        run.interrupt()
        assert run.finals["medium"]["malformed"] > 20
        assert run.finals["world"]["status"] == "interrupted"
