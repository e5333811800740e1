"""A process's connection to the run: the only module that imports Zenoh.

One process hosts the router (`Session.host`), the others log in to it (`Session.connect`). Endpoints are explicit;
scouting and gossip are off. Never fork with a session open: Zenoh's threads do not survive a fork.

Samples go from Zenoh's own thread straight into a queue, and the thread that takes them out decodes them. With
`indirect=False` and a C function as callback no Python code runs in between.
"""

from __future__ import annotations

import json
import os
import re
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Self

import zenoh
from zenoh.handlers import Callback

from bus.access import LEASE_MS, Login, credentials, dictionary, host_config
from bus.excerpt import shown
from bus.keys import Keys, Token
from bus.mailbox import Mailbox, Message, Put, in_parts

__all__ = [
    "BusError", "Login", "Mailbox", "Message", "Put", "Session", "credentials", "free_endpoint", "local_endpoint",
    "new_token", "port_of", "require_free",
]  # fmt: skip

_OPEN_TIMEOUT_S: Final = 20.0
_SOCKET_ROBOTS: Final = 20
_SOCKET_PATH: Final = 107
"""Bytes that the path of a socket may have on Linux."""
_PLAIN: Final = re.compile(r"[\w/. +-]+")

_CLIENT_THREADS: Final = "(rx: (handover: app), app: (worker_threads: 1))"
"""Zenoh's runtime of a client, which reads one socket. The thread that waits for the socket also reads it, which saves
a switch between threads for every message."""

_ROUTER_THREADS: Final = "(rx: (worker_threads: 2))"
"""Zenoh's runtime of the router, its default: one reader goes on while the other waits for a slow receiver."""


class BusError(Exception):
    """The bus can't be reached, hosted or logged in to."""


def port_of(endpoint: str) -> int:
    """Port of an endpoint such as tcp/127.0.0.1:7447.

    Raises:
        BusError: it has no port.
    """
    port = endpoint.rpartition(":")[2]
    if (
        not endpoint.startswith("tcp/")
        or not (port.isascii() and port.isdecimal())
        or len(port) > 5
        or not 0 < int(port) < 65_536
    ):
        raise BusError(f"'{shown(endpoint)}' is not an endpoint such as tcp/127.0.0.1:7447")
    return int(port)


def require_free(endpoint: str) -> None:
    """Check that no process listens on an endpoint yet.

    Raises:
        BusError: its port is in use, or its address does not belong to this machine.
    """
    port = port_of(endpoint)
    host = endpoint.removeprefix("tcp/").rpartition(":")[0].strip("[]")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise BusError(f"port {port} is not free on {shown(host)}: {error.strerror}") from error
        except ValueError:
            raise BusError(f"'{shown(host)}' is no address") from None


def free_endpoint(host: str = "127.0.0.1") -> str:
    """An endpoint on a port that the system has just found free."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return f"tcp/{host}:{probe.getsockname()[1]}"


def local_endpoint(folder: Path, robots: int) -> str:
    """An endpoint for the processes of one machine: for few robots a socket in a folder that no other user may enter.

    A message costs the kernel less there than on a port of the loopback interface (nine processes: 4 to 8 %). But such
    a socket holds 200 kB at most. A frozen process may leave two turns in it, whose inboxes grow with the square of the
    fleet, and the sender of the next message would then wait. A port holds megabytes. A port also serves where the
    folder's path is too long for a socket or has characters that mean something in an endpoint.
    """
    path = str(folder / "router")
    if robots > _SOCKET_ROBOTS or len(os.fsencode(path)) > _SOCKET_PATH or not _PLAIN.fullmatch(path):
        return free_endpoint()
    return f"unixsock-stream/{path}"


def new_token(role: str, node: int = 0) -> Token:
    """The token of a process that is starting."""
    return Token(role, node, int.from_bytes(os.urandom(4), "big"))


class Session:
    """An open session and the keys of its run."""

    def __init__(self, session: zenoh.Session, login: Login) -> None:
        self._session = session
        self.keys = Keys(login.run)
        self.login = login
        self._kept: list[object] = []

    @classmethod
    def connect(cls, login: Login, *, watching: bool = False, timeout_s: float = _OPEN_TIMEOUT_S) -> Session:
        """Log in to a router, which may still be starting.

        Args:
            login: user, password and endpoint.
            watching: this session takes no part in the ticks and delays nobody: it misses messages that are not
                `blocking` when it is too slow for them. To any other session the sender writes itself, without a queue
                and a thread in between (a sixth less processor time per tick), and it waits for a slow receiver.
            timeout_s: how long to try.

        Raises:
            BusError: no router answered within `timeout_s`, or it refused the user or the password.
        """
        config = {
            "mode": "client",
            "connect": {
                "endpoints": [login.endpoint],
                "exit_on_failure": True,
                "timeout_ms": int(timeout_s * 1000),
                "retry": {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 1.5},
            },
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "timestamping": {"enabled": False},
            "transport": {
                "shared_memory": {"enabled": False},
                "unicast": {"lowlatency": not watching, "qos": {"enabled": False}},
                "link": {"tx": {"lease": LEASE_MS}},
                "auth": {"usrpwd": {"user": login.user, "password": login.password}},
            },
        }
        os.environ["ZENOH_RUNTIME"] = _CLIENT_THREADS
        problem = f"{shown(login.user)} can't log in at {shown(login.endpoint)} within {timeout_s:g} s"
        return cls(_open(config, problem), login)

    @classmethod
    def host(cls, login: Login, users: Mapping[str, str]) -> Session:
        """Host the router at `login.endpoint` for `users` (passwords by user), and join it.

        Zenoh reads the passwords from a file, which exists in memory only, while the router opens.

        Raises:
            BusError: the port is in use, or the endpoint is malformed.
        """
        if login.endpoint.startswith("tcp/"):
            require_free(login.endpoint)
        os.environ["ZENOH_RUNTIME"] = _ROUTER_THREADS
        with open(os.memfd_create("users"), "w", encoding="utf-8") as file:  # noqa: PTH123  # it has no path
            file.write(dictionary(users))
            file.flush()
            config = host_config(login.run, login.endpoint, users, Path(f"/proc/self/fd/{file.fileno()}"))
            return cls(_open(config, f"can't host a router at {shown(login.endpoint)}"), login)

    def publisher(self, key: str, *, blocking: bool) -> Put:
        """Declare a publisher.

        Args:
            key: full key, no wildcards.
            blocking: a message of the lockstep, which goes out at once and waits for a slow receiver. Other messages
                are dropped when a receiver that only watches is slow.
        """
        control = zenoh.CongestionControl.BLOCK if blocking else zenoh.CongestionControl.DROP
        publisher = self._session.declare_publisher(key, congestion_control=control, express=blocking)
        self._kept.append(publisher)
        return in_parts(publisher.put)

    def subscribe(self, mailbox: Mailbox, *keys: str, bounded: bool = False) -> None:
        """Let all messages on `keys` (wildcards allowed) flow into a mailbox.

        `bounded`: from senders that may put more than they should (`Mailbox.put_bounded`).
        """
        for key in keys:
            handler = Callback(mailbox.put_bounded if bounded else mailbox.put, indirect=False)
            self._kept.append(self._session.declare_subscriber(key, handler))

    def watch(self, mailbox: Mailbox, *keys: str) -> None:
        """Let the coming and going of liveliness tokens flow into a mailbox, beginning with those that are there."""

        def report(sample: zenoh.Sample) -> None:
            mailbox.put((str(sample.key_expr), None if sample.kind == zenoh.SampleKind.DELETE else b""))

        liveliness = self._session.liveliness()
        for key in keys:
            handler = Callback(report, indirect=False)
            self._kept.append(liveliness.declare_subscriber(key, handler, history=True))

    def declare(self, token: Token) -> None:
        """Declare the token of this process. Do so after all of its subscriptions."""
        self._kept.append(self._session.liveliness().declare_token(self.keys.token(token)))

    def answer(self, key: str, reply: Callable[[str], str]) -> None:
        """Answer every query on `key`. `reply` runs in a thread of Zenoh's and must be quick."""

        def respond(query: zenoh.Query) -> None:
            asked = query.payload
            query.reply(key, reply(asked.to_bytes().decode(errors="replace") if asked is not None else ""))

        self._kept.append(self._session.declare_queryable(key, Callback(respond, indirect=False)))

    def ask(self, key: str, question: str, *, timeout_s: float = 5.0) -> str:
        """Send a query; returns the first answer.

        Raises:
            BusError: nobody answered within `timeout_s`.
        """
        for reply in self._session.get(key, payload=question, timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_string()
        raise BusError(f"no answer on {key} within {timeout_s:g} s")

    def connected(self) -> bool:
        """Whether a client still has its router. False for a host, which has none."""
        return bool(self._session.info.routers_zid())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the session after sending what was put before. Its token drops at once, whatever ends the process."""
        self._kept.clear()
        self._session.close()  # type: ignore[no-untyped-call]  # Zenoh leaves it unannotated


def _open(config: Mapping[str, Any], problem: str) -> zenoh.Session:
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        # Zenoh appends the file and line of its own source to the message.
        raise BusError(f"{problem}: {shown(str(error).partition(' at /')[0], 300)}") from error
