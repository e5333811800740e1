"""`deploy/run_local.py` whose logins lie open: `python -m tests.chaos.open_run ARGUMENTS`, with CHAOS_LOGINS=FILE.

In a real run a robot's password is known to its launcher, its medium and its own process only.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import deploy.processes.fleet
from deploy.command import entry
from deploy.processes.fleet import Fleet
from deploy.run_local import main
from world.own_file import write_whole

LOGINS = "CHAOS_LOGINS"


class OpenFleet(Fleet):
    """Tells the logins of its processes."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        told = {user: dataclasses.asdict(login) for user, login in self._logins.items()}
        write_whole(Path(os.environ[LOGINS]), json.dumps(told), 0o600)


if __name__ == "__main__":
    deploy.processes.fleet.Fleet = OpenFleet  # type: ignore[misc]
    entry(main)
