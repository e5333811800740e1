"""A process that speaks another version of the wire takes no part, and is told so in one line that names both."""

from __future__ import annotations

from unittest.mock import patch

import pytest

import bus.member
import medium.process
import world.process
from bus.envelopes import Refused
from bus.keys import WIRE_VERSION, Keys, Token
from bus.lockstep import Kind, unseal
from bus.member import Member, RefusedError
from medium.core import Medium
from medium.messages import Inbox
from tests.fuzzing.samples import scenario
from tests.fuzzing.shells import LOGIN, DeadSession
from world.core import World
from world.messages import Sense
from world.silence import RunError

OTHER = WIRE_VERSION + 1


def token(role: str, node: int = 0) -> tuple[str, bytes]:
    """That a process of another version shows."""
    return Keys(LOGIN.run).token(Token(role, node, 7, OTHER)), b""


def line(name: str) -> str:
    return f"{name} speaks version {OTHER} of the wire, not version {WIRE_VERSION}"


@pytest.fixture
def the_world() -> tuple[world.process.Shell, DeadSession]:
    session, config = DeadSession(), scenario().world_config()
    with patch.object(world.process, "Session", session):
        return world.process.Shell(World(config), config, LOGIN), session


@pytest.mark.parametrize(("role", "node", "name"), [("robot", 3, "robot 3"), ("station", 0, "station")])
def test_the_world_refuses_a_node(
    role: str, node: int, name: str, the_world: tuple[world.process.Shell, DeadSession]
) -> None:
    shell, session = the_world
    shell._mailbox.put(token(role, node))
    shell._receive(0.0)
    assert not shell._attendance.token(node)
    (word,) = session.sent[session.keys.word(node)]
    kind, to, body = unseal(word)
    assert (kind, to, Refused.decode(body).why) == (Kind.REFUSED, 7, line(name))


def test_the_world_ends_a_run_with_such_a_medium(the_world: tuple[world.process.Shell, DeadSession]) -> None:
    shell, _ = the_world
    shell._mailbox.put(token("medium"))
    with pytest.raises(RunError, match=line("medium")):
        shell._receive(0.0)


@pytest.mark.parametrize("role", ["world", "medium"])
def test_a_node_leaves_such_a_run(role: str) -> None:
    with patch.object(bus.member, "Session", DeadSession()):
        member = Member(LOGIN, "robot", 1, Sense.decode, Inbox.decode)
    member.mailbox.put(token(role))
    with member, pytest.raises(RefusedError, match=line(role)):
        member.turn()


def test_the_medium_leaves_such_a_world() -> None:
    config = scenario().medium_config()
    shell = medium.process.Shell(Medium(config), config, DeadSession(), hosts=True)  # type: ignore[arg-type]
    shell._mailbox.put(token("world"))
    with pytest.raises(RefusedError, match=line("world")):
        shell._receive(0.0)
