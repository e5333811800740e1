"""Standard output and error of a process, which may go away while it writes: a pipe is closed, a terminal ends.

What can no longer be written is dropped, and the process goes on. `lost` tells of what somebody would miss: a disk that
is full. It tells nothing of a reader that has left (EPIPE) or of a terminal that has ended (EIO).
"""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from typing import TYPE_CHECKING, Final, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

__all__ = ["LastingStream", "keep_writing", "lost"]

_NOBODY_READS: Final = (errno.EPIPE, errno.EIO)


class LastingStream(io.FileIO):
    """A file descriptor that takes everything, whether or not it can still be written."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self.error: OSError | None = None
        """What ended the writing."""

    def write(self, data: ReadableBuffer) -> int:
        """Write all of `data`, or drop it after an error."""
        view = memoryview(data).cast("B")
        done = 0
        while self.error is None and done < len(view):
            try:
                written = super().write(view[done:])
                if written is None:  # somebody else has made it non-blocking
                    select.select([], [self], [])
                done += written or 0
            except OSError as error:
                self.error = error
        return len(view)


def keep_writing() -> None:
    """Put a `LastingStream` under sys.stdout and sys.stderr. A closed standard descriptor becomes the null device."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest descriptor that is free: this one
    sys.stdout, sys.stderr = _outlet(sys.stdout, 1), _outlet(sys.stderr, 2)


def lost() -> dict[str, str]:
    """Why something was not written that somebody may read, by stream: "standard output", "standard error"."""
    why = {}
    for name, stream in (("standard output", sys.stdout), ("standard error", sys.stderr)):
        raw = getattr(getattr(stream, "buffer", None), "raw", None)
        if isinstance(raw, LastingStream):
            stream.flush()
            if raw.error is not None and raw.error.errno not in _NOBODY_READS:
                why[name] = raw.error.strerror or str(raw.error)
    return why


def _outlet(stream: TextIO | None, descriptor: int) -> io.TextIOWrapper:
    encoding = "utf-8" if stream is None else stream.encoding
    buffer = io.BufferedWriter(LastingStream(descriptor))
    # A character that the encoding lacks is no reason to end, either.
    return io.TextIOWrapper(buffer, encoding=encoding, errors="backslashreplace", line_buffering=True)
