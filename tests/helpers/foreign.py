"""`examples/agent_minimal.py` as a module, and as one robot of a simulation in one process."""

from __future__ import annotations

import functools
import importlib.util
import json
from types import ModuleType
from typing import Any

from bus.envelopes import Answer, Turn
from bus.handover import plain
from bus.lockstep import Kind, seal, unseal
from deploy.scenario import Scenario
from deploy.simulation import Observer, Simulation
from medium.answers import transmission_of
from medium.messages import Frame, Inbox
from tests import ROOT
from world.messages import Motion, Sense

__all__ = ["AGENT", "WithForeign", "agent"]

AGENT = ROOT / "examples" / "agent_minimal.py"


@functools.cache
def agent() -> ModuleType:
    """The example."""
    spec = importlib.util.spec_from_file_location("agent_minimal", AGENT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Foreign:
    """The example's robot, spoken to in bytes alone."""

    def __init__(self, scenario: Scenario, node: int) -> None:
        self._node, self._medium = node, scenario.medium_config()
        self._config = json.loads(json.dumps(plain(scenario.robot_config(node))))
        self.core: Any = None

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:
        turn = Turn(seal(Kind.DATA, 7, sense.encode()), b"" if inbox is None else inbox.encode()).encode()
        self.core, said = agent().take_turn(turn, 7, self._config, self.core)
        kind, token, body = unseal(said)
        assert (kind, token) == (Kind.DATA, 7)
        answer = Answer.decode(body)
        return transmission_of(self._node, answer, self._medium).frames, Motion.decode(answer.motion)

    def table(self) -> None:
        """It shows none."""


class WithForeign(Simulation):
    """A run in this process in which one robot is the example's."""

    def __init__(self, scenario: Scenario, node: int, observer: Observer | None = None) -> None:
        super().__init__(scenario, observer)
        self._foreign = node

    def _robot_for(self, node: int, sense: Sense) -> Any:
        if node != self._foreign:
            return super()._robot_for(node, sense)
        if sense.first and self._incarnation.get(node) != sense.incarnation:
            self._incarnation[node] = sense.incarnation
            self.robots[node] = Foreign(self._scenario, node)  # type: ignore[assignment]
        return self.robots[node]
