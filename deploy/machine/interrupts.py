"""The signals that ask a run to end, from the first moment of the command on."""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Final

__all__ = ["SIGNALS", "TO_ALL", "Interrupts", "end_with"]

SIGNALS: Final = (
    signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU,
)  # fmt: skip
"""By which a user, a key, a batch system or the end of a terminal asks a command to end."""

TO_ALL: Final = tuple(number for number in SIGNALS if number != signal.SIGTERM)
"""Those that a terminal or a batch system sends to all processes of a command. Only its first one reacts, and ends the
others by SIGTERM."""


class Interrupts:
    """Counts `SIGNALS`, and passes each on to the run once there is one.

    Nothing is raised, so no step of the start is left half done.
    """

    def __init__(self) -> None:
        """Listen. What is ignored already, as SIGHUP under nohup, stays ignored; not so SIGINT and SIGTERM."""
        self.count = 0
        self._passed = 0
        self._interrupt: Callable[[], None] | None = None
        for number in SIGNALS:
            if number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._take)

    def pass_to(self, interrupt: Callable[[], None]) -> None:
        """Call `interrupt` for each signal, those that came before included. It must be quick."""
        self._interrupt = interrupt
        self._pass()

    def _take(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1
        self._pass()

    def _pass(self) -> None:
        while self._interrupt is not None and self._passed < self.count:
            self._passed += 1
            self._interrupt()


def end_with(owner: int) -> None:
    """Send SIGTERM to this process as soon as process `owner` is gone. Returns at once.

    Raises:
        ValueError: no process can have that id.
    """
    descriptor: int | None = None
    try:
        descriptor = os.pidfd_open(owner)
    except ProcessLookupError:
        pass  # gone already
    except (OSError, OverflowError):
        raise ValueError("not the id of a process") from None

    def watch() -> None:
        if descriptor is not None:
            select.select([descriptor], [], [])
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="owner", daemon=True).start()
