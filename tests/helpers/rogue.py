"""Clients with a robot's own password that do what no process of a run does. Functions for processes of their own."""

from __future__ import annotations

import os
import signal

from bus.envelopes import Answer
from bus.heartbeat import Beat
from bus.lockstep import Kind, seal
from bus.session import Login, Mailbox, Session, new_token

__all__ = ["beat_flood", "flood", "impostor", "stopped_listener"]

FLOOD = 200_000
ANSWERS = 50


def stopped_listener(login: Login, node: int) -> None:
    """Hears all turns of a robot, and stands still."""
    session = Session.connect(login)
    session.subscribe(Mailbox(), session.keys.rx(node))
    os.kill(os.getpid(), signal.SIGSTOP)


def flood(login: Login, node: int) -> None:
    """Many answers of some kilobytes."""
    with Session.connect(login) as session:
        put = session.publisher(session.keys.tx(node), blocking=True)
        answer = seal(Kind.DATA, 7, Answer(0, bytes(7000), b"").encode())
        for _ in range(FLOOD):
            put(answer)


def beat_flood(login: Login, node: int) -> None:
    """Many beats."""
    with Session.connect(login) as session:
        put = session.publisher(session.keys.beat(node), blocking=True)
        beat = Beat(7, 1.0).encode()
        for _ in range(FLOOD):
            put(beat)


def impostor(login: Login, node: int) -> None:
    """Answers in the name of a robot again and again, and does not go when it is refused."""
    token = new_token("robot", node)
    with Session.connect(login) as session:
        put = session.publisher(session.keys.tx(node), blocking=True)
        session.declare(token)
        mailbox = Mailbox()
        session.subscribe(mailbox, session.keys.word(node))
        for _ in range(ANSWERS):
            put(seal(Kind.DATA, token.incarnation, Answer(0, b"", b"").encode()))
            mailbox.get(0.02)
