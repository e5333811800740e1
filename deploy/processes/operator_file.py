"""The files by which an operator and external robots find and enter a run, in its folder while it is under way."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Final

from bus.access import Login
from bus.nodes import user_name
from deploy.json_file import read_object
from world.own_file import write_whole

__all__ = ["OPERATOR", "credentials_name", "living_launcher", "read_operator", "write_operator"]

OPERATOR: Final = "operator.json"
_MOST_PID: Final = 2**31 - 1


def credentials_name(robot: int) -> str:
    """Name of the file that an external robot reads."""
    return f"{user_name(robot)}.json"


def write_operator(folder: Path, login: Login) -> None:
    """Write the operator's credentials and the id of this process, readable by this user only."""
    text = json.dumps({
        "run": login.run, "endpoint": login.endpoint, "user": login.user, "password": login.password,
        "launcher": os.getpid(),
    })  # fmt: skip
    write_whole(folder / OPERATOR, text, mode=0o600)


def read_operator(folder: Path) -> Login:
    """The operator's login.

    Raises:
        ValueError: no run is under way there, or its file is damaged.
    """
    told = read_object(folder / OPERATOR)
    login = [told.get(name) for name in ("run", "endpoint", "user", "password")]
    if not all(isinstance(word, str) for word in login):
        raise ValueError(f"{OPERATOR} has no login")
    return Login(*map(str, login))


def living_launcher(folder: Path) -> int | None:
    """Process id of the launcher whose run is under way in a run folder; None if there is none."""
    try:
        pid = read_object(folder / OPERATOR).get("launcher")
    except ValueError:
        return None
    if not isinstance(pid, int) or not 0 < pid <= _MOST_PID:
        return None
    try:
        os.kill(pid, 0)
    except PermissionError:
        return pid
    except OSError:
        return None
    return pid
