"""Files that a command writes: complete or not at all, and never in place of one of the user's."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

from bus.excerpt import shown

__all__ = ["ForeignFileError", "require_own", "write_whole"]

_MARK_WITHIN: Final = 4096
"""Bytes from the start in which a file says who wrote it."""


class ForeignFileError(ValueError):
    """A file that the command did not write, where it wants to write one; one line for the user."""


def write_whole(path: Path, content: str | bytes, mode: int = 0o666) -> None:
    """Write a file that appears under its name when it is complete: what was there stays until then.

    Args:
        path: of the file.
        content: text is written as UTF-8; what that lacks, as bytes of a file's name that are no text, as an escape.
        mode: who may do what with it, less what the umask takes away.

    Raises:
        OSError: it can't be written, and nothing has changed.
    """
    draft = path.with_name(path.name + ".part")
    try:
        draft.unlink(missing_ok=True)
        with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content.encode(errors="backslashreplace") if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error


def require_own(path: Path, mark: str) -> None:
    """Check that a file is not there yet, or has `mark` near its start: what its writer puts into every such file.

    Raises:
        ForeignFileError: it is another's.
        OSError: it can't be read.
    """
    try:
        with path.open("rb") as file:
            start = file.read(_MARK_WITHIN)
    except FileNotFoundError:
        return
    if mark.encode() not in start:
        raise ForeignFileError(f"{shown(path)}: is there already, and is no file of this command: name another one")
