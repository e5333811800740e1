"""A file of a run that grows entry by entry, and outlives a disk that is full."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

__all__ = ["GrowingFile"]


class GrowingFile:
    """Each entry is the kernel's as soon as it is written. After the first that can't be written, none follows."""

    def __init__(self, path: Path, whole: int = 0) -> None:
        """Open or create the file, and cut off what is behind its first `whole` bytes.

        Raises:
            OSError: it can't be created.
        """
        self._file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "r+b", buffering=0)
        self._file.truncate(whole)
        self._whole = self._file.seek(whole)
        """Bytes of all entries."""
        self.error: OSError | None = None
        """What ended the writing."""

    def write(self, entry: bytes | str) -> None:
        """Append an entry, or drop it after an error. Text is written as UTF-8."""
        if self.error is not None:
            return
        left = memoryview(entry.encode(errors="backslashreplace") if isinstance(entry, str) else entry)
        try:
            while left:
                left = left[self._file.write(left) :]
            self._whole = self._file.tell()
        except OSError as error:
            self._end(error)

    def flush(self) -> None:
        """Bring everything written so far to disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._end(error)

    def close(self) -> None:
        self._file.close()

    def _end(self, error: OSError) -> None:
        self.error = self.error or error
        # Half a number would pass for a whole one.
        with contextlib.suppress(OSError):
            self._file.truncate(self._whole)
