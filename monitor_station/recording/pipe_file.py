"""The file of a recording, which Rerun writes through a pipe.

Rerun cannot tell that its file can't be written: it logs a line of its own, and the next flush waits for ever. So Rerun
writes into a pipe, which always takes everything, and a thread of ours moves what arrives to the file.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Final

from world.growing_file import GrowingFile

__all__ = ["PipeFile"]

_AT_ONCE: Final = 1 << 14
"""Bytes that are written at a time. On a disk that is full the last of them are given back: room for a summary."""


class PipeFile:
    """A file, and a pipe that fills it."""

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it can't be created.
        """
        self._file = GrowingFile(path)
        self._read, self._write = os.pipe()
        self._thread = threading.Thread(target=self._move, name="recording", daemon=True)
        self._thread.start()

    @property
    def entrance(self) -> Path:
        """What Rerun opens, and closes at its end."""
        return Path(f"/proc/self/fd/{self._write}")

    def close(self) -> None:
        """Wait until all is in the file. Rerun has closed its end.

        Raises:
            OSError: not all could be written.
        """
        os.close(self._write)
        self._thread.join()
        self._file.close()
        if self._file.error is not None:
            raise self._file.error

    def _move(self) -> None:
        while data := os.read(self._read, _AT_ONCE):
            self._file.write(data)
        os.close(self._read)
