"""Signs of life of a process that is long at work on a turn, from a thread beside it.

A turn that takes longer than a moment is no silence: the world waits for a process that works, and gives up one that
does not. So a beat carries the processor time that the process has spent on this turn. A process that is stopped, or
held up by compiled code that keeps the interpreter's lock, sends no beat; one that waits for something else sends
beats whose processor time does not grow. A turn that is over within a beat costs two additions.
"""

from __future__ import annotations

import math
import struct
import threading
import time
from dataclasses import dataclass
from typing import Final

from bus.codec import WireError
from bus.lockstep import Kind, seal, unseal
from bus.mailbox import Put

__all__ = ["BEAT_S", "Beat", "Heartbeat"]

BEAT_S: Final = 0.25
"""Wall time between two beats."""
_LEAVE_S: Final = 1.0
_SPENT: Final = struct.Struct("<d")


@dataclass(frozen=True, slots=True)
class Beat:
    """Node -> world: its process works."""

    token: int
    """Of the process."""
    spent_s: float
    """Processor time of the process since it went from waiting to work."""

    def encode(self) -> bytes:
        return seal(Kind.DATA, self.token, _SPENT.pack(self.spent_s))

    @staticmethod
    def decode(data: bytes) -> Beat:
        _, token, body = unseal(data)
        if len(body) != _SPENT.size:
            raise WireError("a beat is a token and a time")
        (spent_s,) = _SPENT.unpack(body)
        if not (math.isfinite(spent_s) and spent_s >= 0.0):
            raise WireError("a beat's time is not finite and 0 or more")
        return Beat(token, spent_s)


class Heartbeat:
    """Beats whenever its process has been at work for a while."""

    def __init__(self, token: int, put: Put) -> None:
        """Start the thread; `token` is of this process, and `put` sends a beat."""
        self.switches = 1
        """Its owner adds 1 whenever it goes from work to waiting or back: odd while it works."""
        self._token, self._put = token, put
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        seen, since_s = 0, 0.0
        while not self._over.wait(BEAT_S):
            switches = self.switches
            if switches == seen and switches % 2:
                self._put(Beat(self._token, time.process_time() - since_s).encode())
            else:
                seen, since_s = switches, time.process_time()

    def stop(self) -> None:
        """Send no more beats."""
        self._over.set()
        self._thread.join(_LEAVE_S)  # it may be sending one, past a router that is stopped
