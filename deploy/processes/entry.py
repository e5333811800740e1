"""The first function of each process of a run.

A module is imported only in the process that needs it, or by the fork server.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from bus.access import Login

__all__ = ["PRELOAD", "run_medium", "run_robot", "run_station", "run_world"]

PRELOAD: Final = (
    "numpy", "msgpack", "zenoh", "world.process", "medium.process", "agents.process", "monitor_station.process",
    "deploy.processes.supervisor", "deploy.processes.entry",
)  # fmt: skip
"""Modules that the fork server imports, once for all processes."""


def run_world(config: Any, login: Login) -> None:
    from world.process import run

    run(config, login)


def run_medium(config: Any, login: Login, users: Mapping[str, str]) -> None:
    from medium.process import run

    run(config, login, users)


def run_robot(config: Any, login: Login) -> None:
    from agents.process import run

    run(config, login)


def run_station(config: Any, login: Login, recorder: Any, out: Path, live_port: int | None) -> None:
    from monitor_station.process import run

    run(config, login, recorder, out, live_port)
