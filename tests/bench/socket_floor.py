"""The floors over ZeroMQ and over bare Unix sockets: the same messages between the same processes, as raw bytes.

There is no routing, no key, no login and no encoding, so these floors measure processes and pipes only.
"""

from __future__ import annotations

import selectors
import socket
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol

from bus.nodes import process_name
from deploy.processes.supervisor import Supervisor
from tests.bench.pattern import Pattern, TickTimes

__all__ = ["start_unix", "start_zeromq"]

MEDIUM: Final = "medium"
_WORLD: Final = 65_535
"""Id of the world in the medium's hub."""
_STOP: Final = b"stop"
_OPEN_S: Final = 60.0
_ID: Final = struct.Struct("<H")


class Hub(Protocol):
    """The end to which all nodes are connected."""

    def send(self, peer: int, data: bytes) -> None: ...
    def receive(self) -> tuple[int, bytes]: ...


class Leaf(Protocol):
    """A node's end of its connection to a hub."""

    def send(self, data: bytes) -> None: ...
    def receive(self) -> bytes: ...


HubMaker = Callable[[Path, str, int], Hub]
LeafMaker = Callable[[Path, str, int], Leaf]


def start_unix(pattern: Pattern, supervisor: Supervisor, result: Path) -> None:
    """Start the floor over Unix sockets (SOCK_SEQPACKET)."""
    _start(pattern, supervisor, result, UnixHub, UnixLeaf)


def start_zeromq(pattern: Pattern, supervisor: Supervisor, result: Path) -> None:
    """Start the floor over ZeroMQ (ROUTER and DEALER, ipc)."""
    _start(pattern, supervisor, result, ZeroHub, ZeroLeaf)


def _start(pattern: Pattern, supervisor: Supervisor, result: Path, hub: HubMaker, leaf: LeafMaker) -> None:
    supervisor.start(MEDIUM, _medium, pattern, result.parent, hub)
    supervisor.start("world", _world, pattern, result, leaf)
    for node in pattern.nodes:
        supervisor.start(process_name(node), _node, pattern, result.parent, node, leaf)


def _world(pattern: Pattern, result: Path, leaf: LeafMaker) -> None:
    medium = leaf(result.parent, MEDIUM, _WORLD)
    times = TickTimes(result, pattern.wall_s)
    tick, positions_bytes = 0, 18 * len(pattern.nodes)
    while times.tick():
        medium.send(bytes(positions_bytes + sum(pattern.sense_bytes(node, tick) for node in pattern.nodes)))
        medium.receive()
        tick += 1
    medium.send(_STOP)
    times.write()


def _medium(pattern: Pattern, folder: Path, hub: HubMaker) -> None:
    lines = hub(folder, MEDIUM, len(pattern.nodes) + 1)
    tick, moves = 0, bytes(60 * len(pattern.nodes))
    while lines.receive()[1] != _STOP:
        for node in pattern.nodes:
            lines.send(node, bytes(pattern.sense_bytes(node, tick) + pattern.inbox_bytes))
        for _ in pattern.nodes:
            lines.receive()
        lines.send(_WORLD, moves)
        tick += 1
    for node in pattern.nodes:
        lines.send(node, _STOP)


def _node(pattern: Pattern, folder: Path, node: int, leaf: LeafMaker) -> None:
    medium = leaf(folder, MEDIUM, node)
    answer = bytes(pattern.frame_bytes + 60)
    while medium.receive() != _STOP:
        medium.send(answer)


class UnixHub:
    """A listening socket and its connections."""

    def __init__(self, folder: Path, name: str, peers: int) -> None:
        self._selector = selectors.DefaultSelector()
        self._lines: dict[int, socket.socket] = {}
        self._ready: list[tuple[int, socket.socket]] = []
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as door:
            draft = folder / f"{name}.part"
            door.bind(str(draft))
            door.listen(peers)
            draft.rename(folder / name)
            for _ in range(peers):
                line, _ = door.accept()
                (peer,) = _ID.unpack(line.recv(_ID.size))
                self._lines[peer] = line
                self._selector.register(line, selectors.EVENT_READ, (peer, line))

    def send(self, peer: int, data: bytes) -> None:
        self._lines[peer].send(data)

    def receive(self) -> tuple[int, bytes]:
        if not self._ready:
            self._ready = [key.data for key, _ in self._selector.select()]
        peer, line = self._ready.pop()
        return peer, line.recv(1 << 18)


class UnixLeaf:
    """A connected socket."""

    def __init__(self, folder: Path, name: str, node: int) -> None:
        path = folder / name
        _await(path)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.connect(str(path))
        self._line.send(_ID.pack(node))

    def send(self, data: bytes) -> None:
        self._line.send(data)

    def receive(self) -> bytes:
        return self._line.recv(1 << 18)


class ZeroHub:
    """A ROUTER socket whose peers have all said hello."""

    def __init__(self, folder: Path, name: str, peers: int) -> None:
        import zmq

        self._socket: Any = zmq.Context().socket(zmq.ROUTER)
        self._socket.bind(f"ipc://{folder / name}")
        for _ in range(peers):
            self._socket.recv_multipart()

    def send(self, peer: int, data: bytes) -> None:
        self._socket.send_multipart((_ID.pack(peer), data))

    def receive(self) -> tuple[int, bytes]:
        peer, data = self._socket.recv_multipart()
        return _ID.unpack(peer)[0], data


class ZeroLeaf:
    """A DEALER socket."""

    def __init__(self, folder: Path, name: str, node: int) -> None:
        import zmq

        self._socket: Any = zmq.Context().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.ROUTING_ID, _ID.pack(node))
        self._socket.connect(f"ipc://{folder / name}")
        self._socket.send(b"hello")

    def send(self, data: bytes) -> None:
        self._socket.send(data)

    def receive(self) -> bytes:
        data: bytes = self._socket.recv()
        return data


def _await(path: Path) -> None:
    """Wait for a file to appear: the process that listens on it may still be starting."""
    until = time.monotonic() + _OPEN_S
    while not path.exists():
        if time.monotonic() > until:
            raise TimeoutError(f"nobody listens at {path}")
        time.sleep(0.005)
