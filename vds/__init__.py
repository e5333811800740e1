"""The VDS emulator for programs, notebooks and tests; nothing else needs to be imported.

    import vds

    result = vds.Simulation(vds.load("three_cells", {"robots": 9, "seed": 3})).run()
    print(result.finals["station"]["search_time_s"], result.trace_sha256)

* A scenario: `load`, `Scenario`, `ScenarioError`.
* One run in this process, as fast as it can be: `Simulation`, `Observer`, `Result`, `Traces`. Many that share a past:
  `branch`.
* One run of real processes: `Emulation`, `EmulationError`; in tests the fixture `emulation`, which pytest finds without
  an import (docs/faults.md). What it tells: `Snapshot`, `Event`.
* Rules of one's own: `Policy` and, for it, `Action`, `Body`, `Cls`, `LinkQuality`, `Mode`, `NOBODY`, `Place`
  (docs/writing-a-policy.md).

The command `vds` does the same in a terminal: `vds --help`.

A name is imported as it is first used. So `import vds` is quick, and pytest's plugin takes no name of a user's package.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from vds.packages import ShadowedError, require_ours

if TYPE_CHECKING:
    from agents.body import Action, Body
    from agents.link_quality import LinkQuality
    from agents.vds import Vds as Policy
    from deploy.branching import branch
    from deploy.emulation import Emulation, EmulationError
    from deploy.scenario import Scenario, ScenarioError, load
    from deploy.simulation import Observer, Result, Simulation, Traces
    from vds.pytest_plugin import emulation
    from world.feed import Event, Snapshot
    from world.terms import NOBODY, Cls, Mode, Place

__all__ = [
    "NOBODY", "Action", "Body", "Cls", "Emulation", "EmulationError", "Event", "LinkQuality", "Mode", "Observer",
    "Place", "Policy", "Result", "Scenario", "ScenarioError", "ShadowedError", "Simulation", "Snapshot", "Traces",
    "branch", "emulation", "load",
]  # fmt: skip

_FROM = {
    "agents.body": ("Action", "Body"),
    "agents.link_quality": ("LinkQuality",),
    "agents.vds": ("Policy",),
    "deploy.branching": ("branch",),
    "deploy.emulation": ("Emulation", "EmulationError"),
    "deploy.scenario": ("Scenario", "ScenarioError", "load"),
    "deploy.simulation": ("Observer", "Result", "Simulation", "Traces"),
    "vds.pytest_plugin": ("emulation",),
    "world.feed": ("Event", "Snapshot"),
    "world.terms": ("NOBODY", "Cls", "Mode", "Place"),
}
"""By module: the names that are taken from it. The imports above say the same to type checkers."""
_OTHERWISE = {"Policy": "Vds"}
"""What a module calls one of these names."""


def __getattr__(name: str) -> Any:
    """Import a public name.

    Raises:
        ShadowedError: a package of the user's stands where Python looks for ours.
        AttributeError: there is no such name.
    """
    module = next((module for module, names in _FROM.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module 'vds' has no attribute '{name}'")
    require_ours()
    value = globals()[name] = getattr(importlib.import_module(module), _OTHERWISE.get(name, name))
    return value


def __dir__() -> list[str]:
    return __all__
