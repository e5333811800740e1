"""A run two of whose robots never show themselves before its first tick, as a program: `python -m ... DIR`.

Robot 2 is killed as soon as its process has started, robot 3 is stopped then, and continued once the run goes on.
Whoever waited for them until `deadlines.return_s` would wait for an hour.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import agents.process
from bus.session import local_endpoint
from deploy.processes.fleet import Fleet
from deploy.processes.launcher import Launcher
from deploy.processes.supervisor import Supervisor
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from deploy.screen.view import NoView
from world.feed import Snapshot

CONTINUED_AT = 10


def struck(number: int, config: Any, login: Any) -> None:
    os.kill(os.getpid(), number)
    agents.process.run(config, login)


class EarlyFleet(Fleet):
    def start(self, supervisor: Supervisor, node: int) -> None:
        number = {2: signal.SIGKILL, 3: signal.SIGSTOP}.get(node)
        if number is None:
            super().start(supervisor, node)
        else:
            config, login = self._scenario.robot_config(node), self._logins[f"robot-{node}"]
            supervisor.start(f"robot/{node}", struck, number, config, login)


class Continues(NoView):
    """Continues robot 3 when it sees that the run goes on."""

    pids: Mapping[str, int] = {}

    def processes(self, pids: Mapping[str, int]) -> None:
        self.pids = pids

    def snapshot(self, snapshot: Snapshot) -> None:
        if snapshot.tick == CONTINUED_AT:
            os.kill(self.pids["robot/3"], signal.SIGCONT)


def main() -> int:
    scenario = load("three_cells", {"robots": 4, "duration_s": 12.0, "speed": 2.0, "deadlines.return_s": 3600.0})
    with RunFolder(Path(sys.argv[1]), scenario) as folder, tempfile.TemporaryDirectory(prefix="vds-") as place:
        fleet = EarlyFleet(scenario, folder.path, local_endpoint(Path(place), 4), record=False)
        outcome = Launcher(fleet, folder, Continues()).run()
    print(*outcome.failures, sep="\n")
    return outcome.exit_status


if __name__ == "__main__":
    sys.exit(main())
