"""Which class decides for a robot, by the name in a scenario: `vds`, `scout`, or `module:Class`.

For shells and scenarios: it imports what a user names, and cores are given the class.
"""

from __future__ import annotations

import importlib
import sys

from agents.scout import Scout
from agents.vds import Vds

_NAMED: dict[str, type[Vds]] = {"vds": Vds, "scout": Scout}


class PolicyError(ValueError):
    """A name that leads to no policy."""


def policy_class(name: str) -> type[Vds]:
    """Look a policy up.

    Raises:
        PolicyError: no such name, module or class, or a class that is not derived from agents.vds.Vds.
    """
    if name in _NAMED:
        return _NAMED[name]
    module, colon, attribute = name.partition(":")
    if not colon:
        raise PolicyError(f"should be one of {', '.join(_NAMED)}, or module:Class")
    if "" not in sys.path:
        sys.path.append("")  # a policy of one's own mostly lies where the run is started
    try:
        found = getattr(importlib.import_module(module), attribute, None)
    except ImportError as error:
        raise PolicyError(f"cannot import {module}: {error}") from None
    if not (isinstance(found, type) and issubclass(found, Vds)):
        raise PolicyError(f"{module} has no class {attribute} derived from agents.vds.Vds")
    return found
