"""The floor of the first design: its dataflow over plain Zenoh, raw bytes between cores that do nothing.

There, senses, inboxes, frames and motions are messages of their own, four for each node and tick, over ordinary links
and without access rules. Its cost once bounded the emulator; the messages of today cost less.
"""

from __future__ import annotations

import json
import queue
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from bus.nodes import process_name
from bus.session import free_endpoint
from deploy.processes.supervisor import Supervisor
from tests.bench.pattern import Pattern, TickTimes

__all__ = ["start"]

_MOTION_BYTES: Final = 64
_STOP: Final = b"stop"
_START_S: Final = 60.0


def start(pattern: Pattern, supervisor: Supervisor, result: Path) -> None:
    """Start all processes of the floor; the world writes `result` at the end."""
    endpoint = free_endpoint()
    supervisor.start("medium", _medium, pattern, endpoint)
    supervisor.start("world", _world, pattern, endpoint, result)
    for node in pattern.nodes:
        supervisor.start(process_name(node), _node, pattern, endpoint, node)


class _Line:
    """A session and its mailbox."""

    def __init__(self, endpoint: str, *keys: str, hosts: bool = False) -> None:
        end: dict[str, Any] = {"endpoints": [endpoint]}
        if not hosts:
            end |= {"timeout_ms": int(1e3 * _START_S), "retry": {"period_init_ms": 20, "period_max_ms": 200}}
        config = {
            "mode": "router" if hosts else "client",
            "listen" if hosts else "connect": end,
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        }
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self._came: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._kept: list[object] = [
            self._session.declare_subscriber(key, Callback(self._came.put, indirect=False)) for key in keys
        ]

    def put(self, key: str) -> Callable[[bytes], None]:
        control = zenoh.CongestionControl.BLOCK
        return self._session.declare_publisher(key, congestion_control=control, express=True).put

    def show(self, name: object) -> None:
        """Tell the world that this process listens."""
        self._kept.append(self._session.liveliness().declare_token(f"here/{name}"))

    def await_all(self, names: Iterable[object]) -> None:
        """Wait until all processes listen."""
        missing = {f"here/{name}" for name in names}
        came: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        tokens = self._session.liveliness()
        self._kept.append(tokens.declare_subscriber("here/*", Callback(came.put, indirect=False), history=True))
        while missing:
            missing.discard(str(came.get(timeout=_START_S).key_expr))

    def get(self) -> tuple[str, bytes]:
        sample = self._came.get(timeout=_START_S)
        return str(sample.key_expr), sample.payload.to_bytes()

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


def _world(pattern: Pattern, endpoint: str, result: Path) -> None:
    line = _Line(endpoint, "motion/*", "done")
    put_sense = [line.put(f"sense/{node}") for node in pattern.nodes]
    put_positions = line.put("positions")
    line.await_all(["medium", *pattern.nodes])
    times, tick = TickTimes(result, pattern.wall_s), 0
    while times.tick():
        put_positions(bytes(18 * len(pattern.nodes)))
        for node in pattern.nodes:
            put_sense[node](bytes(pattern.sense_bytes(node, tick)))
        for _ in ("done", *pattern.nodes):
            line.get()
        tick += 1
    for put in (put_positions, *put_sense):
        put(_STOP)
    times.write()
    line.close()


def _medium(pattern: Pattern, endpoint: str) -> None:
    line = _Line(endpoint, "tx/*", "positions", hosts=True)
    put_rx = [line.put(f"rx/{node}") for node in pattern.nodes]
    put_done = line.put("done")
    line.show("medium")
    heard, stopping = bytes(pattern.inbox_bytes), False
    while not stopping:
        for _ in ("positions", *pattern.nodes):
            stopping |= line.get()[1] == _STOP
        for put in put_rx:
            put(heard)
        put_done(b"done")
    line.close()  # it hosts the router: all nodes have sent their last message


def _node(pattern: Pattern, endpoint: str, node: int) -> None:
    line = _Line(endpoint, f"sense/{node}", f"rx/{node}")
    put_tx, put_motion = line.put(f"tx/{node}"), line.put(f"motion/{node}")
    line.show(node)
    frames, motion = bytes(pattern.frame_bytes), bytes(_MOTION_BYTES)
    waits = {"sense"}  # in the first tick there is no inbox
    while True:
        key, data = line.get()
        if data == _STOP:
            break
        waits.discard(key.partition("/")[0])
        if not waits:
            waits = {"sense", "rx"}
            put_tx(frames)
            put_motion(motion)
    put_tx(_STOP)
    line.close()
