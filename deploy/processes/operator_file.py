"""The file in a run folder by which an operator finds and enters a run: there only while the run lives."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Final

from bus.access import Login
from deploy.json_file import read_table
from world.own_file import write_whole

__all__ = ["OPERATOR", "living_launcher", "read_operator", "write_operator"]

OPERATOR: Final = "operator.json"
_MOST_PID: Final = 2**31 - 1


def write_operator(folder: Path, login: Login) -> None:
    """Leave the operator's credentials and this process's id, readable by this user only."""
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
    told = read_table(folder / OPERATOR)
    login = [told.get(name) for name in ("run", "endpoint", "user", "password")]
    if not all(isinstance(word, str) for word in login):
        raise ValueError(f"{OPERATOR} has no login")
    return Login(*map(str, login))


def living_launcher(folder: Path) -> int | None:
    """Pid of the launcher of the run that is under way in a run folder, or None."""
    try:
        pid = read_table(folder / OPERATOR).get("launcher")
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
