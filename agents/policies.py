"""Policy classes by their name in a scenario: `vds`, `scout`, `sortie`, or `module:Class`.

For shells and scenarios: it imports what a user names. Cores are given the class.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping

from agents.scout import Scout
from agents.sortie import Sortie
from agents.vds import Vds
from bus.culprit import culprit
from bus.excerpt import shown

_NAMED: dict[str, type[Vds]] = {"vds": Vds, "scout": Scout, "sortie": Sortie}


class PolicyError(ValueError):
    """The name of a policy that does not exist."""


def policy_class(name: str) -> type[Vds]:
    """The policy class of a name.

    Raises:
        PolicyError: no such name, module or class, or a class that is not derived from agents.vds.Vds.
    """
    if name in _NAMED:
        return _NAMED[name]
    module, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), attribute)):
        raise PolicyError(f"should be one of {', '.join(_NAMED)}, or module:Class")
    if "" not in sys.path:
        sys.path.append("")  # a user's policy mostly lies in the folder where the run is started
    try:
        found = getattr(importlib.import_module(module), attribute, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a module may raise anything, and end the process by SystemExit
        kind = "" if isinstance(error, ImportError) else f"{type(error).__name__}: "
        why = error.msg if isinstance(error, SyntaxError) else str(error)
        where = culprit(error)
        line = f" ({shown(where, 100)})" if where else ""
        raise PolicyError(f"cannot import {shown(module)}: {kind}{shown(why, 60)}{line}") from None
    if not (isinstance(found, type) and issubclass(found, Vds)):
        raise PolicyError(f"{shown(module)} has no class {shown(attribute)} derived from agents.vds.Vds")
    if not isinstance(found.DEFAULTS, Mapping) or not all(isinstance(key, str) for key in found.DEFAULTS):
        raise PolicyError(f"{shown(attribute)}.DEFAULTS is not a table of a scenario's keys")
    return found
