"""What a run of many processes needs of the system's limits, and which it keeps."""

from __future__ import annotations

import os
import resource
from typing import Final

__all__ = ["LimitError", "allow_files", "one_thread"]

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


def one_thread() -> None:
    """Keep numerical libraries, here and in processes to come, from starting threads: there is a process per core."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
