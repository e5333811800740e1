"""A link that takes nothing is cut, and nothing else is."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.access import credentials, users_of
from bus.breaker import Breaker
from bus.session import Login, Mailbox, Session, free_endpoint, local_endpoint, new_token
from tests.helpers.waiting import wait_until

LONG_S = 1000.0
"""The limit of a test comes first."""


def freeze(login: Login) -> None:
    session = Session.connect(login)
    session.subscribe(Mailbox(), session.keys.rx(4))
    session.declare(new_token("robot", 4))
    os.kill(os.getpid(), signal.SIGSTOP)


class Late(Breaker):
    """Tells of a cut when the owner has gone on to another node."""

    stuck = 0
    """The node whose put was stuck last."""

    def _cut_links(self) -> int:
        self.stuck, cut = self.node, super()._cut_links()
        wait_until(lambda: self.node != self.stuck, "the next put")
        return cut


class Router:
    """A router whose host puts turns on one key, one subscriber that is frozen and one that listens.

    To the breaker each turn is one for another node.
    As in lockstep, a turn comes after the one before was heard. Where two threads write to one low-latency link that is
    full, Zenoh 1.10.2 may never wake one of them again.
    """

    def __init__(self, endpoint: str) -> None:
        logins = credentials("breaker", endpoint, 5)
        self.host = Session.host(logins["medium"], users_of(logins))
        self.hears = threading.Event()
        self.tokens, self.heard = Mailbox(), Mailbox(self.hears.set)
        self.host.watch(self.tokens, self.host.keys.alive("robot"))
        self.frozen = multiprocessing.get_context("spawn").Process(target=freeze, args=(logins["robot-4"],))
        self.frozen.start()
        self.came = self.tokens.get(LONG_S)
        self.listener = Session.connect(logins["robot-4"])
        self.listener.subscribe(self.heard, self.listener.keys.rx(4))
        self.listener.declare(new_token("robot", 4))
        assert self.tokens.get(LONG_S) is not None
        self.cuts: list[int] = []
        self.cut, self.over = threading.Event(), threading.Event()
        self.breaker = Late(endpoint, self._was_cut)
        self.speaker = threading.Thread(target=self._speak, daemon=True)

    def _was_cut(self, node: int) -> None:
        self.cuts.append(node)
        self.cut.set()

    def _speak(self) -> None:
        put = self.host.publisher(self.host.keys.rx(4, 1), blocking=True)
        while not self.over.is_set():
            self.hears.clear()
            self.breaker.node += 1
            self.breaker.puts += 1
            put(bytes(30_000))
            self.breaker.puts += 1
            self.hears.wait()

    def close(self) -> None:
        self.over.set()
        self.frozen.kill()
        self.frozen.join()
        self.speaker.join(30.0)
        self.listener.close()
        self.host.close()


@pytest.fixture(params=["socket", "port"])
def router(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Router]:
    made = Router(local_endpoint(tmp_path, 5) if request.param == "socket" else free_endpoint())
    yield made
    made.close()


def test_a_link_that_takes_nothing_is_cut_and_the_others_stay(router: Router) -> None:
    with router.breaker:
        router.speaker.start()
        assert router.cut.wait(LONG_S)
        assert router.cuts == [router.breaker.stuck]
        assert router.came is not None
        assert router.tokens.get(LONG_S) == (router.came[0], None), "its token has dropped"
        while router.heard.get(0.0) is not None:
            pass
        assert router.heard.get(LONG_S) is not None, "the turns go on"
        assert router.listener.connected()
