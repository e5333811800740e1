"""The shells of medium, world and node without a bus: honest ticks, and among them whatever may come in."""

from __future__ import annotations

import functools
import random
from collections.abc import Callable
from typing import Any, Self
from unittest.mock import patch

import numpy as np

import bus.member
import medium.process
import world.process
from bus.access import Login
from bus.envelopes import Answer, Moves, Opening, Turn
from bus.keys import Keys, Token
from bus.lockstep import Kind, seal
from bus.mailbox import Message
from bus.member import Member
from medium.core import Medium
from medium.messages import BROADCAST, Inbox, Transmission
from tests.fuzzing.mutations import mutated
from tests.fuzzing.samples import recorded, scenario
from world.core import World
from world.messages import Motion, Positions, Report, Sense, Status
from world.terms import STATION

LOGIN = Login("run", "tcp/127.0.0.1:1", "robot-1", "secret")
TICKS = 3


class DeadSession:
    """A session without a bus: `sent` has what was put, by key."""

    def __init__(self) -> None:
        self.keys, self.login = Keys(LOGIN.run), LOGIN
        self.sent: dict[str, list[bytes]] = {}

    def connect(self, *_: Any, **__: Any) -> Self:
        return self

    def publisher(self, key: str, *, blocking: bool) -> Callable[[bytes], None]:  # noqa: ARG002  # the real one's
        return self.sent.setdefault(key, []).append

    def nothing(self, *_: Any, **__: Any) -> None:
        """Listens to nobody, and shows itself to nobody."""

    subscribe = watch = declare = answer = close = nothing

    def connected(self) -> bool:
        return True


def noise(rng: random.Random, keys: Keys, *on: str) -> Message:
    """A message that is no honest one, on one of some keys; or the token of a robot, which may be none."""
    packed = recorded().packed
    if rng.random() < 0.1:
        token = rng.choice((f"{rng.randrange(2**32):08x}", "x" * rng.choice((1, 8, 9, 5000))))
        return keys.alive("robot", rng.choice((1, 9, 99_999, "9" * 5000)), token, rng.choice((1, 1, 2, 99_999))), b""
    kinds = {
        keys.positions: ("opening", "departed"), keys.moved: ("moves",), keys.rx(1): ("turn", "sense"),
        keys.beat(1): ("beat",), keys.absence: ("absence",),
    }  # fmt: skip
    key = rng.choice(on)
    kind = rng.choice(kinds.get(key, ("answer", "transmission", "motion")))
    data = rng.choice(packed[kind])
    if rng.random() < 0.8:
        data = seal(rng.choice((Kind.DATA, Kind.DEPARTED, Kind.PING)), rng.choice((0, 1, 2)), data)
    return key, mutated(rng, data, [rng.choice(packed[kind])])


def word(node: int, tick: int, cells: int) -> bytes:
    """What an honest node says beside its frames."""
    if node == STATION:
        return Report(tick, False, (0.0,) * cells, 0).encode()
    return Motion(tick, 0.1, 0.0, Status()).encode()


def medium_goes_on(rng: random.Random, messages: int) -> None:
    """The medium completes honest ticks, whatever else it hears."""
    session = DeadSession()
    config = scenario().medium_config()
    shell = medium.process.Shell(Medium(config), config, session, hosts=True)  # type: ignore[arg-type]
    keys = session.keys
    for tick in range(TICKS):
        for _ in range(messages):
            shell._mailbox.put(noise(rng, keys, keys.positions, *(keys.tx(node) for node in (0, 1, 4, 9, 99_999))))
            assert shell._receive(0.0)
        positions = Positions(tick, np.arange(5, dtype=np.int16), np.array([(28.0 + n, 35.0) for n in range(5)]))
        senses = [(node, seal(Kind.DATA, node + 1, b"sense")) for node in range(5)]
        shell._mailbox.put((keys.positions, seal(Kind.DATA, 0, Opening(positions.encode(), senses).encode())))
        for node in range(5):
            said = Transmission(tick, node, ((BROADCAST, b"hello"),)).encode()
            answer = Answer(tick, said, word(node, tick, config.cells))
            shell._mailbox.put((keys.tx(node), seal(Kind.DATA, node + 1, answer.encode())))
        while shell._receive(0.0):
            pass
        assert tick in [Moves.decode(moved).complete for moved in session.sent[keys.moved]]


def world_goes_on(rng: random.Random, messages: int) -> None:
    """The world completes honest ticks, whatever else it hears."""
    session, config = DeadSession(), scenario().world_config()
    with patch.object(world.process, "Session", session):
        shell = world.process.Shell(World(config), config, LOGIN)
    keys = session.keys
    for token in Token("medium", 0, 1), *(Token("robot" if n else "station", n, n + 1) for n in range(5)):
        shell._mailbox.put((keys.token(token), b""))
    for tick in range(TICKS):
        assert shell._ready()
        begin = shell._core.begin()
        shell._send(begin)
        for _ in range(messages):
            shell._mailbox.put(noise(rng, keys, keys.moved, keys.pong, keys.beat(1), keys.absence))
            shell._receive(0.0)
        answers = [(node, node + 1, tick, word(node, tick, len(config.cell_names))) for node in begin.senses]
        shell._mailbox.put((keys.moved, Moves(answers, tick).encode()))
        shell._collect()
        shell._end()
        shell._publish()
        assert shell._core.tick == tick + 1


def node_goes_on(rng: random.Random, messages: int) -> None:
    """A node takes its turns, whatever else it hears."""
    session, config = DeadSession(), scenario().robot_config(1)
    inbox_of = functools.partial(Inbox.decode, robots=config.robots)
    with patch.object(bus.member, "Session", session):
        member = Member(LOGIN, "robot", 1, Sense.decode, inbox_of)
    keys, incarnation = session.keys, member._token.incarnation
    rx = keys.rx(1, incarnation)
    for tick in range(TICKS):
        for _ in range(messages):
            key, data = noise(rng, keys, keys.rx(1), keys.word(1))
            if key in (keys.rx(1), keys.word(1)) and data[:1] != bytes([Kind.STOP]):
                member.mailbox.put((rx if key == keys.rx(1) else key, data))
        member.mailbox.put((keys.alive("world", 0, "none of ours", 1), b""))
        sense = seal(Kind.DATA, incarnation, Sense(tick, tick == 0, 0, 28.0, 35.0).encode())
        member.mailbox.put((rx, Turn(sense, Inbox(tick, ()).encode()).encode()))
        turn = member.turn()
        assert turn is not None
        assert turn[0].tick == tick
    member.close()
