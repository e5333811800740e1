"""The file in a run folder by which an operator finds and enters a run: there only while the run lives."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Final

from bus.access import Login
from world.own_file import write_whole

__all__ = ["OPERATOR", "living_launcher", "read_operator", "write_operator"]

OPERATOR: Final = "operator.json"


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
        OSError, ValueError, KeyError: no run is under way there.
    """
    told = json.loads((folder / OPERATOR).read_text(encoding="utf-8"))
    return Login(told["run"], told["endpoint"], told["user"], told["password"])


def living_launcher(folder: Path) -> int | None:
    """Pid of the launcher of the run that is under way in a run folder, or None."""
    try:
        pid = int(json.loads((folder / OPERATOR).read_text(encoding="utf-8"))["launcher"])
        os.kill(pid, 0)
    except PermissionError:
        return pid
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return pid
