"""A run whose robot 2 raises in the middle, as a program: `python -m tests.helpers.failing_agent DIR`.

It prints what failed.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from agents.process import run
from agents.robot import Robot
from bus.session import local_endpoint
from deploy.processes.fleet import Fleet
from deploy.processes.launcher import Launcher
from deploy.processes.supervisor import Supervisor
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from deploy.screen.view import NoView

FAILS_AT_TICK = 30


class FailingRobot(Robot):
    def step(self, sense: Any, inbox: Any) -> Any:
        if sense.tick == FAILS_AT_TICK:
            raise ArithmeticError("a robot that can't go on")
        return super().step(sense, inbox)


def failing_robot(config: Any, login: Any) -> None:
    import agents.process

    agents.process.Robot = FailingRobot  # type: ignore[misc]
    run(config, login)


class FailingFleet(Fleet):
    def start(self, supervisor: Supervisor, node: int) -> None:
        if node == 2:
            supervisor.start("robot/2", failing_robot, self._scenario.robot_config(2), self._logins["robot-2"])
        else:
            super().start(supervisor, node)


def main() -> int:
    scenario = load("three_cells", {"robots": 3, "duration_s": 10.0})
    with RunFolder(Path(sys.argv[1]), scenario) as folder, tempfile.TemporaryDirectory(prefix="vds-") as temporary:
        fleet = FailingFleet(scenario, folder.path, local_endpoint(Path(temporary), 3), record=False)
        outcome = Launcher(fleet, folder, NoView()).run()
    print(*outcome.failures, sep="\n")
    return outcome.exit_status


if __name__ == "__main__":
    sys.exit(main())
