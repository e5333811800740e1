"""Who may log in, and who may put or receive on which key, with real Zenoh and a client of our own."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import random
import signal
import threading
from collections.abc import Iterator
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest
import zenoh

from bus.access import MOST_BYTES, credentials, dictionary, router_config, rules, users_of
from bus.codec import WireError
from bus.keys import ROWS, Keys, Token, check_run
from bus.mailbox import PART_BYTES, Message
from bus.session import (
    BusError,
    Login,
    Mailbox,
    Session,
    free_endpoint,
    local_endpoint,
    new_token,
    port_of,
    require_free,
)

ROBOTS = 5
SILENCE_S = 0.3


def next_of(mailbox: Mailbox) -> Message:
    """The next message, however long it takes to come."""
    while (message := mailbox.get(1.0)) is None:
        pass
    return message


class Bus:
    """A hosted router with the medium and the world listening, and robot 4."""

    def __init__(self) -> None:
        self.logins = credentials("access", free_endpoint(), ROBOTS)
        self.medium = Session.host(self.logins["medium"], users_of(self.logins))
        self.world = Session.connect(self.logins["world"])
        self.robot = Session.connect(self.logins["robot-4"])
        self.sessions = [self.robot, self.world, self.medium]
        self.at_medium, self.at_world, self.at_robot = Mailbox(), Mailbox(), Mailbox()
        keys = self.keys = Keys("access")
        self.medium.subscribe(self.at_medium, keys.tx("*"), keys.positions)
        self.world.subscribe(self.at_world, keys.moved, keys.pong, keys.flood, keys.absence)
        self.tokens_of_world = Mailbox()
        self.medium.watch(self.tokens_of_world, keys.alive("world"))
        self.world_is_known()

    def world_is_known(self) -> None:
        """The router has taken what the world declared: one session's declarations are taken in their order, so a
        token declared last comes out last. A put of another session may overtake declarations.
        """
        token = new_token("world")
        self.world.declare(token)
        assert self.arrives(self.tokens_of_world, self.keys.token(token), b"")

    def login(self, user: str) -> Session:
        session = Session.connect(self.logins[user])
        self.sessions.insert(0, session)
        return session

    def arrives(self, mailbox: Mailbox, key: str, data: bytes) -> bool:
        return next_of(mailbox) == (key, data)

    def silent(self, *mailboxes: Mailbox) -> bool:
        """Nothing has come, though a permitted message that was put later has."""
        key = self.keys.tx(1)
        # Not robot 4 itself: its session would deliver its own messages to it.
        self.login("robot-1").publisher(key, blocking=True)(b"last")
        heard = self.arrives(self.at_medium, key, b"last")
        if self.at_world in mailboxes:
            self.medium.publisher(self.keys.moved, blocking=True)(b"last")
            heard = heard and self.arrives(self.at_world, self.keys.moved, b"last")
        return heard and all(m.get(SILENCE_S) is None for m in mailboxes)


@pytest.fixture
def bus() -> Iterator[Bus]:
    made = Bus()
    yield made
    for session in made.sessions:
        session.close()


def test_robot_may_say_and_hear_what_is_its_own(bus: Bus) -> None:
    keys = bus.keys
    bus.robot.subscribe(bus.at_robot, keys.word(4), keys.rx(4, 1))
    bus.robot.publisher(keys.tx(4), blocking=True)(b"answer")
    assert bus.arrives(bus.at_medium, keys.tx(4), b"answer")
    bus.medium.publisher(keys.moved, blocking=True)(b"moves")
    assert bus.arrives(bus.at_world, keys.moved, b"moves")
    bus.world.publisher(keys.word(4), blocking=True)(b"word")
    assert bus.arrives(bus.at_robot, keys.word(4), b"word")
    bus.medium.publisher(keys.rx(4, 2), blocking=True)(b"turn of another process")
    bus.medium.publisher(keys.rx(4, 1), blocking=True)(b"turn")
    assert bus.arrives(bus.at_robot, keys.rx(4, 1), b"turn")
    bus.world.subscribe(bus.at_world, keys.beat("*"))
    bus.world_is_known()
    bus.robot.publisher(keys.beat(4), blocking=True)(b"beat")
    assert bus.arrives(bus.at_world, keys.beat(4), b"beat")
    token = new_token("robot", 4)
    tokens = Mailbox()
    bus.world.watch(tokens, keys.alive("robot"))
    bus.robot.declare(token)
    assert bus.arrives(tokens, keys.token(token), b"")


def test_robot_cannot_say_what_is_not_its_own(bus: Bus) -> None:
    keys = bus.keys
    to_world = (keys.moved, keys.pong, keys.flood, keys.absence)
    others = (keys.tx(5), keys.tx("*"), keys.tx(0), keys.rx(4, 1), keys.word(4), keys.beat(5), keys.positions)
    for key in (*others, *to_world):
        if "*" not in key:
            bus.robot.publisher(key, blocking=True)(b"spoof")
        bus.robot._session.put(key, b"spoof")
    tokens = Mailbox()
    bus.world.watch(tokens, keys.alive("robot"))
    bus.robot.declare(new_token("robot", 5))
    assert bus.silent(bus.at_medium, bus.at_world, tokens)


@pytest.mark.parametrize(
    "key",
    [
        "vds/access/@sim/rx/5/00000001", "vds/access/@sim/rx/*/*", "vds/access/@sim/tx/*", "vds/access/@sim/word/5",
        "vds/access/@sim/word/*", "vds/access/@sim/positions", "vds/access/@sim/feed", "vds/access/@sim/**",
        "vds/access/**", "**",
    ],
)  # fmt: skip
def test_robot_cannot_hear_what_is_not_its_own(bus: Bus, key: str) -> None:
    keys = bus.keys
    bus.robot.subscribe(bus.at_robot, key)
    bus.medium.publisher(keys.rx(5, 1), blocking=True)(b"turn")
    for other in (keys.word(5), keys.positions, keys.feed):
        bus.world.publisher(other, blocking=True)(b"truth")
    bus.login("robot-5").publisher(keys.tx(5), blocking=True)(b"frames")
    seen = {next_of(bus.at_medium), next_of(bus.at_medium)}
    assert seen == {(keys.positions, b"truth"), (keys.tx(5), b"frames")}
    assert bus.silent(bus.at_robot)


def test_robot_cannot_command_the_world_but_the_operator_can(bus: Bus) -> None:
    control = bus.keys.control
    bus.world.answer(control, str.upper)
    bus.world_is_known()
    with pytest.raises(BusError):
        bus.robot.ask(control, "hold", timeout_s=SILENCE_S)
    assert bus.login("operator").ask(control, "hold") == "HOLD"


def test_a_message_longer_than_a_link_takes_comes_whole(bus: Bus) -> None:
    message = random.Random(1).randbytes(3_000_000)
    bus.robot.publisher(bus.keys.tx(4), blocking=True)(message)
    assert bus.arrives(bus.at_medium, bus.keys.tx(4), message)


def _watch(login: Login, ready: Event) -> None:
    session, mailbox = Session.connect(login, watching=True), Mailbox()
    session.subscribe(mailbox, session.keys.table("*"))
    ready.set()
    while mailbox.get(60.0) is not None:
        pass


def test_a_watcher_that_hangs_delays_nobody(bus: Bus) -> None:
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    watcher = context.Process(target=_watch, args=(bus.logins["station"], ready), daemon=True)
    watcher.start()
    try:
        assert ready.wait()
        assert watcher.pid is not None
        os.kill(watcher.pid, signal.SIGSTOP)
        put, answer = bus.robot.publisher(bus.keys.table(4), blocking=False), bus.keys.tx(4)
        put_answer = bus.robot.publisher(answer, blocking=True)

        def speak() -> None:
            for _ in range(2000):  # 40 MB, more than any buffer holds
                put(bytes(20_000))
            put_answer(b"answer")

        speaker = threading.Thread(target=speak, daemon=True)
        speaker.start()
        speaker.join()  # as long as the test may take, if it waits for the watcher
        assert bus.arrives(bus.at_medium, answer, b"answer")
    finally:
        watcher.kill()
        watcher.join()


def _freeze(login: Login) -> None:
    session, mailbox = Session.connect(login), Mailbox()
    session.subscribe(mailbox, session.keys.rx(4, 1))
    session.declare(new_token("robot", 4))
    os.kill(os.getpid(), signal.SIGSTOP)


@pytest.mark.parametrize("robots", [20, 100])
def test_who_is_frozen_may_leave_two_turns_unread(robots: int, tmp_path: Path) -> None:
    """With inboxes of a fleet in which everybody hears everybody, 28 bytes a row, and some scan reports."""
    logins = credentials("frozen", local_endpoint(tmp_path, robots), robots)
    context = multiprocessing.get_context("spawn")
    frozen = context.Process(target=_freeze, args=(logins["robot-4"],), daemon=True)
    with Session.host(logins["medium"], users_of(logins)) as medium:
        tokens = Mailbox()
        medium.watch(tokens, medium.keys.alive("robot"))
        frozen.start()
        try:
            assert next_of(tokens)
            put, turn = medium.publisher(medium.keys.rx(4, 1), blocking=True), bytes(28 * robots**2 + 40_000)
            speaker = threading.Thread(target=lambda: (put(turn), put(turn)), daemon=True)
            speaker.start()
            speaker.join()  # as long as the test may take, if it waits for who is frozen
        finally:
            frozen.kill()
            frozen.join()


def test_a_message_that_no_process_of_ours_sends_whole_reaches_nobody(bus: Bus) -> None:
    """Ours send a long one in parts. A link of the other kind carries any length, and the router would collect it."""
    key = bus.keys.tx(4)
    with Session.connect(bus.logins["robot-4"], watching=True) as stranger:
        put = stranger._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK).put
        put(bytes(PART_BYTES))
        assert bus.arrives(bus.at_medium, key, bytes(PART_BYTES))
        put(bytes(2 * MOST_BYTES))
        assert bus.silent(bus.at_medium)


def test_stranger_and_wrong_password_are_refused(bus: Bus) -> None:
    wrong = dataclasses.replace(bus.logins["robot-4"], password="guess")
    with pytest.raises(BusError, match="robot-4 can't log in"):
        Session.connect(wrong, timeout_s=0.5)
    stranger = {
        "mode": "client",
        "connect": {"endpoints": [wrong.endpoint], "timeout_ms": 500, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}},
    }
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(stranger)))


def test_port_in_use_is_named(bus: Bus) -> None:
    endpoint = bus.logins["medium"].endpoint
    port = endpoint.rpartition(":")[2]
    with pytest.raises(BusError, match=f"port {port} is not free"):
        Session.host(bus.logins["medium"], users_of(bus.logins))
    with pytest.raises(BusError, match="endpoint"):
        require_free("localhost")


def test_passwords_are_random_and_do_not_show() -> None:
    first, second = (credentials("run", "tcp/127.0.0.1:1", 2) for _ in range(2))
    assert set(first) == {"world", "medium", "operator", "station", "robot-1", "robot-2"}
    assert len({login.password for logins in (first, second) for login in logins.values()}) == 12
    assert first["world"].password not in repr(first["world"])
    assert Login("run", "tcp/127.0.0.1:1", "world", "x") != first["world"]
    assert dictionary({"b": "2", "a": "1"}) == "a:1\nb:2\n"


def test_rules_deny_by_default_and_every_key_has_a_sender_and_a_receiver() -> None:
    access = rules("run", ["world", "medium", "station", "operator", "robot-1"])
    assert access["default_permission"] == "deny"
    by_id = {rule["id"]: rule["key_exprs"] for rule in access["rules"]}
    assert by_id["robot-1 ingress put"] == [
        "vds/run/@sim/beat/1", "vds/run/@sim/phases/robot-1", "vds/run/@sim/table/1", "vds/run/@sim/tx/1",
    ]  # fmt: skip
    assert by_id["robot-1 egress put"] == ["vds/run/@sim/rx/1/*", "vds/run/@sim/word/1"]
    assert by_id["robot-1 ingress declare_subscriber"] == by_id["robot-1 egress put"]
    assert all(row.senders and row.receivers for row in ROWS.values())


def test_external_router_gets_the_same_rules() -> None:
    config = json.loads(router_config("run", "tcp/0.0.0.0:7447", ["world"], Path("users.txt")))
    assert config["access_control"] == rules("run", ["world"])
    assert not config["scouting"]["multicast"]["enabled"]


@pytest.mark.parametrize("name", ["", "a/b", "a*", "@a", "a b", "a#", "$a"])
def test_run_name_must_be_one_chunk(name: str) -> None:
    with pytest.raises(ValueError, match="can't name a run"):
        check_run(name)


@pytest.mark.parametrize(
    "token",
    [
        "4/1/nonsense",
        "4/1/*",
        "4/1/-0000001",
        "x/1/00000001",
        "4/1/1",
        "4/1/123456789",
        "9" * 5000 + "/1/00000001",
        "4/00000001",
        "4/x/00000001",
        "4/123456/00000001",
    ],
)
def test_a_token_that_is_none_is_a_wire_error(token: str) -> None:
    with pytest.raises(WireError):
        Keys.token_of(f"vds/run/alive/robot/{token}")
    with pytest.raises(WireError):
        Keys.token_of(token.rpartition("/")[2])
    with pytest.raises(WireError):
        Keys.node_of(f"vds/run/@sim/tx/{'9' * 5000}")


def test_keys_are_read_back() -> None:
    keys = Keys("run")
    token = new_token("robot", 4)
    assert keys.token_of(keys.token(token)) == token
    assert not token.mismatch
    assert keys.token_of(keys.alive("robot", 4, "0123abcd", 7)) == Token("robot", 4, 0x123ABCD, 7)
    assert [Keys.node_of(k) for k in (keys.tx(4), keys.beat(5), keys.table(6), keys.word(0))] == [4, 5, 6, 0]


@pytest.mark.parametrize(
    ("folder", "robots", "local"),
    [("/tmp/x", 20, True), ("/tmp/x", 21, False), ("/tmp/" + "x" * 200, 3, False), ("/tmp/a#b?c", 3, False)],
)
def test_a_local_endpoint_is_a_socket_only_where_one_can_be(folder: str, robots: int, local: bool) -> None:
    endpoint = local_endpoint(Path(folder), robots)
    assert endpoint == f"unixsock-stream/{folder}/router" if local else port_of(endpoint) > 0


def test_the_router_leaves_no_password_on_a_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    logins = credentials("memory", local_endpoint(tmp_path, 3), 3)
    with Session.host(logins["medium"], users_of(logins)), Session.connect(logins["world"]) as session:
        assert session.connected()
        assert {path.name for path in tmp_path.iterdir()} == {"router", "router.lock"}
