"""Links that take nothing while the process that hosts the router waits for one of them: they are cut.

A link on the low-latency transport has no queue, so its sender waits for a receiver that does not read, and with it
everybody who is routed. Zenoh itself would wait for ever. A process of a run never has so many messages under way that
its link fills up; a stranger with its password may subscribe and then stand still.
"""

from __future__ import annotations

import os
import select
import socket
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Self

__all__ = ["STUCK_S", "Breaker"]

STUCK_S: Final = 2.0
"""A put that takes longer is stuck. Counted in looks, so that a suspended host costs no process its link."""
_LOOKS: Final = 4


class Breaker:
    """Looks at the puts of one thread from a thread beside it, and cuts links when one is stuck. A context manager."""

    def __init__(self, endpoint: str, cut: Callable[[int], None]) -> None:
        """Watch nothing yet.

        Args:
            endpoint: of the router, which this process hosts.
            cut: told for which node a put was stuck, in the thread of the breaker.
        """
        self.puts = 0
        """The owner adds 1 before and after each put: odd while one is under way."""
        self.node = 0
        """For whom it is."""
        address = endpoint.partition("/")[2]
        self._here = {address, address.rpartition(":")[2]}
        """Path of the router's socket, or its port."""
        self._cut = cut
        self._over = threading.Event()

    def __enter__(self) -> Self:
        threading.Thread(target=self._run, name="breaker", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def _run(self) -> None:
        seen, looks = 0, 0
        while not self._over.wait(STUCK_S / _LOOKS):
            looks = looks + 1 if self.puts == seen and seen % 2 else 0
            seen = self.puts
            if looks == _LOOKS:
                looks, node = 0, self.node  # a put that is stuck no longer is followed by one for another node
                if self._cut_links():
                    self._cut(node)

    def _cut_links(self) -> int:
        """Shut down every link of the router that has no room left; returns how many."""
        cut = 0
        for link in self._links():
            with link:
                poll = select.poll()
                poll.register(link, select.POLLOUT)
                if not poll.poll(0):
                    link.shutdown(socket.SHUT_RDWR)
                    cut += 1
        return cut

    def _links(self) -> Iterator[socket.socket]:
        """The connections to the router's socket. Zenoh does not hand them out, so the kernel is asked."""
        for entry in Path("/proc/self/fd").iterdir():
            try:
                if not stat.S_ISSOCK(os.fstat(int(entry.name)).st_mode):
                    continue
                link = socket.socket(fileno=os.dup(int(entry.name)))
            except OSError:  # closed meanwhile
                continue
            try:
                here = link.getsockname()
                link.getpeername()
            except OSError:  # the socket that listens
                link.close()
                continue
            if str(here[1] if isinstance(here, tuple) else here) in self._here:
                yield link
            else:
                link.close()
