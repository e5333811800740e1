"""A client with a robot's own password that does what no process of a run does, as a program.

python -m tests.chaos.rogue LOGINS NODE SEED ACT
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from bus.envelopes import Answer
from bus.heartbeat import Beat
from bus.lockstep import Kind, seal
from bus.session import BusError, Login, Mailbox, Session, new_token
from tests.fuzzing.mutations import mutated

__all__ = ["ACTS"]

_MESSAGES: Final = 30_000
_TAUNTS: Final = 300


def floods(session: Session, node: int, rng: random.Random) -> None:
    """Many answers of some kilobytes, or many beats."""
    if rng.random() < 0.5:
        key, message = session.keys.tx(node), seal(Kind.DATA, 7, Answer(0, bytes(7000), b"").encode())
    else:
        key, message = session.keys.beat(node), Beat(7, 1.0).encode()
    put = session.publisher(key, blocking=True)
    for _ in range(_MESSAGES):
        put(message)


def freezes(session: Session, node: int, rng: random.Random) -> None:
    """Hears the turns of a robot, or passes for a second process of it, and stands still."""
    session.subscribe(Mailbox(), session.keys.rx(node), session.keys.word(node))
    if rng.random() < 0.5:
        session.declare(new_token("robot", node))
    os.kill(os.getpid(), signal.SIGSTOP)


def talks_nonsense(session: Session, node: int, rng: random.Random) -> None:
    """Broken messages on every key that a robot may put on."""
    keys = session.keys
    answer = Answer(rng.randrange(200), b"\x93\x05\x02\x90", b"motion").encode()
    honest = [answer, seal(Kind.DATA, 7, answer), Beat(7, 1.0).encode(), b"\x91" * 1000 + b"\x01"]
    puts = [
        session.publisher(key, blocking=True)
        for key in (keys.tx(node), keys.beat(node), keys.table(node), keys.phases(f"robot-{node}"))
    ]
    for _ in range(_TAUNTS):
        data = mutated(rng, rng.choice(honest), honest)
        rng.choice(puts)(rng.choice((data, seal(rng.choice(list(Kind)), rng.getrandbits(32), data))))
        if rng.random() < 0.1:
            Mailbox().get(0.01)


def poses(session: Session, node: int, rng: random.Random) -> None:
    """Passes for a new process of the robot, and does not go when it is refused."""
    token, mailbox = new_token("robot", node), Mailbox()
    session.subscribe(mailbox, session.keys.word(node), session.keys.rx(node, token.incarnation))
    session.declare(token)
    put = session.publisher(session.keys.tx(node), blocking=True)
    for _ in range(_TAUNTS):
        put(seal(Kind.DATA, token.incarnation, Answer(rng.randrange(200), b"", b"").encode()))
        mailbox.get(0.01)


ACTS: Final[dict[str, Callable[[Session, int, random.Random], None]]] = {
    act.__name__: act for act in (floods, freezes, talks_nonsense, poses)
}


def main(logins: str, node: str, seed: str, act: str) -> None:
    """Wait for a line, log in, tell, and act; a run that ends meanwhile is no matter."""
    sys.stdin.readline()  # all modules are loaded, so it can be quick now
    told = json.loads(Path(logins).read_text())[f"robot-{node}"]
    try:
        with Session.connect(Login(**told)) as session:
            print("logged in", flush=True)
            ACTS[act](session, int(node), random.Random(f"{act} {seed}"))
    except BusError as error:
        print(error, file=sys.stderr)


if __name__ == "__main__":
    main(*sys.argv[1:])
