"""Policy classes by their name in a scenario: `vds`, `scout`, or `module:Class`.

For shells and scenarios: it imports what a user names. Cores are given the class.
"""

from __future__ import annotations

import importlib
import sys

from agents.scout import Scout
from agents.vds import Vds
from bus.culprit import culprit

_NAMED: dict[str, type[Vds]] = {"vds": Vds, "scout": Scout}


class PolicyError(ValueError):
    """The name of a policy that does not exist."""


def policy_class(name: str) -> type[Vds]:
    """The policy class of a name.

    Raises:
        PolicyError: no such name, module or class, or a class that is not derived from agents.vds.Vds.
    """
    if name in _NAMED:
        return _NAMED[name]
    module, colon, attribute = name.partition(":")
    if not colon:
        raise PolicyError(f"should be one of {', '.join(_NAMED)}, or module:Class")
    if "" not in sys.path:
        sys.path.append("")  # a user's policy mostly lies in the folder where the run is started
    try:
        found = getattr(importlib.import_module(module), attribute, None)
    except Exception as error:  # whatever the module does when it is imported
        kind = "" if isinstance(error, ImportError) else f"{type(error).__name__}: "
        words = error.msg if isinstance(error, SyntaxError) else error
        where = culprit(error)
        raise PolicyError(f"cannot import {module}: {kind}{words}{f' ({where})' if where else ''}") from None
    if not (isinstance(found, type) and issubclass(found, Vds)):
        raise PolicyError(f"{module} has no class {attribute} derived from agents.vds.Vds")
    return found
