"""Waiting for a condition, and whether a process lives."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

__all__ = ["alive", "wait_until"]


def alive(pid: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Return as soon as the condition holds. The limit is the test's: a busy machine would break a shorter one."""
    try:
        while not condition():
            time.sleep(0.01)
    except BaseException as error:
        error.add_note(f"waited for: {what}")
        raise
