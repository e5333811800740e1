"""The world's shell without a bus."""

from __future__ import annotations

from unittest.mock import patch

import world.process
from bus.heartbeat import Beat
from bus.keys import Token
from tests.fuzzing.samples import scenario
from tests.fuzzing.shells import LOGIN, DeadSession
from world.core import World

TOO_MANY = 100_000


def test_beats_of_a_new_process_count_after_those_of_the_one_before_were_too_many() -> None:
    session, config = DeadSession(), scenario().world_config()
    with patch.object(world.process, "Session", session):
        shell = world.process.Shell(World(config), config, LOGIN)
    keys, mailbox = session.keys, shell._mailbox

    def beats(count: int) -> None:
        for _ in range(count):
            mailbox.put((keys.beat(1), Beat(7, 1.0).encode()))
            shell._receive(0.0)

    mailbox.put((keys.token(Token("robot", 1, 7)), b""))
    shell._receive(0.0)
    beats(1)
    assert not mailbox.excess
    beats(TOO_MANY)
    assert mailbox.excess == {keys.beat(1): 0}
    assert not shell._attendance.seated(1, 8)
    mailbox.put((keys.token(Token("robot", 1, 8)), b""))
    shell._receive(0.0)
    assert shell._attendance.seated(1, 8)
    beats(500)
    assert not mailbox.excess
