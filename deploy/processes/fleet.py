"""The processes of one run: their names, their configs and their logins."""

from __future__ import annotations

import dataclasses
import uuid
from pathlib import Path
from typing import IO, TYPE_CHECKING

from bus.access import Login, credentials, users_of
from bus.handover import contents
from bus.keys import check_run
from bus.nodes import process_name, user_name
from deploy.processes.entry import PRELOAD, run_medium, run_robot, run_station, run_world
from deploy.processes.operator_file import credentials_name
from deploy.processes.processors import assigned, shared
from deploy.processes.supervisor import Supervisor
from world.own_file import write_whole
from world.terms import STATION

if TYPE_CHECKING:
    from deploy.scenario import Scenario

__all__ = ["Fleet"]


class Fleet:
    """The processes of one scenario: world, medium, and one for each node that is not external."""

    def __init__(
        self,
        scenario: Scenario,
        out: Path,
        endpoint: str,
        *,
        record: bool = True,
        live_port: int | None = None,
        held: bool = False,
        plain_scheduling: bool = False,
    ) -> None:
        """Make the logins and the name of the run. Nothing starts yet.

        Args:
            scenario: what to run.
            out: run folder.
            endpoint: of the router.
            record: leave a recording.
            live_port: serve the recording to viewers on this port, too.
            held: begin held, as after the operator's `hold`.
            plain_scheduling: let the kernel choose the processor of each process.
        """
        self._scenario = scenario
        self._out = out
        self._run = _run_name(out)
        self._logins = credentials(self._run, endpoint, scenario.robots)
        self._world = dataclasses.replace(scenario.world_config(), held=held)
        self._recorder = None
        if record:
            # A restarted station goes on in another file of the same recording.
            self._recorder = dataclasses.replace(scenario.recorder_config(self._run), recording_id=str(uuid.uuid4()))
        self._live_port = live_port
        self.external = scenario.external
        nodes = [process_name(node) for node in self._own_nodes()]
        processors = () if plain_scheduling else shared(len(nodes) + len(("world", "medium")))
        self._processors = assigned(processors, nodes)

    @property
    def operator(self) -> Login:
        """The login of the launcher and of operators."""
        return self._logins["operator"]

    @property
    def last_node(self) -> int:
        return self._scenario.robots

    def _own_nodes(self) -> list[int]:
        """Those whose processes are started here."""
        return [node for node in range(self.last_node + 1) if node not in self.external]

    def supervisor(self, held: IO[bytes]) -> Supervisor:
        """A supervisor for these processes, each of which holds a file open. It has started none of them."""
        return Supervisor(self._run, self._out / "logs", PRELOAD, self._processors, held)

    def start_all_but_last(self, supervisor: Supervisor) -> None:
        """Start medium, world, and all nodes but `last_node`, or the external ones where there are such.

        The world begins once that one, or these, are there too.
        """
        users = users_of(self._logins)
        supervisor.start("medium", run_medium, self._scenario.medium_config(), self._logins["medium"], users)
        supervisor.start("world", run_world, self._world, self._logins["world"])
        for node in self._own_nodes():
            if node != self.last_node or self.external:
                self.start(supervisor, node)

    def start_last(self, supervisor: Supervisor) -> None:
        """Start `last_node`; or write the files without which external robots can't log in.

        Raises:
            OSError: one can't be written.
        """
        if not self.external:
            self.start(supervisor, self.last_node)
        for node in self.external:
            text = contents(self._logins[user_name(node)], config=self._scenario.robot_config(node))
            write_whole(self.credentials_file(node), text, mode=0o600)

    def credentials_file(self, node: int) -> Path:
        """What an external robot reads."""
        return self._out / credentials_name(node)

    @property
    def patience_s(self) -> float:
        """How long the world waits for processes at the start."""
        return self._world.return_deadline_s

    def start(self, supervisor: Supervisor, node: int) -> None:
        """Start the process of a node."""
        name, login = process_name(node), self._logins[user_name(node)]
        if node == STATION:
            station = self._scenario.station_config()
            supervisor.start(name, run_station, station, login, self._recorder, self._out, self._live_port)
        else:
            supervisor.start(name, run_robot, self._scenario.robot_config(node), login)


def _run_name(folder: Path) -> str:
    """The name of a run as a chunk of a key: that of its folder."""
    name = "".join("-" if c in "/*$?#@" or c.isspace() or not c.isprintable() else c for c in folder.resolve().name)
    return check_run(name or "run")
