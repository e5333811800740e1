"""What a run of many processes needs of the system's limits."""

from __future__ import annotations

import resource
from typing import Final

__all__ = ["LimitError", "allow_files"]

_EACH: Final = 3
"""Files that the launcher holds for each process; the medium, which hosts the router, holds fewer."""
_OTHERS: Final = 64
"""Files that a launcher or a medium holds besides."""
_WORLD_MEDIUM_STATION: Final = 3


class LimitError(ValueError):
    """The system does not allow enough; one line for the user."""


def allow_files(robots: int) -> None:
    """Raise the limit of open files, of this process and those that it will start, to what a run needs.

    Raises:
        LimitError: that is more than this user may have.
    """
    needed = _OTHERS + _EACH * (robots + _WORLD_MEDIUM_STATION)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise LimitError(
            f"robots = {robots}: a run of {robots} robot processes needs {needed} open files, and {hard} are allowed: "
            "raise the limit (ulimit -n), or run with --in-process"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
