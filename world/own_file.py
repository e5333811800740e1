"""Files that a command writes: complete or not at all, and never in place of one of the user's."""

from __future__ import annotations

import contextlib
import itertools
import os
from pathlib import Path
from typing import IO, Final

from bus.excerpt import shown
from bus.user_file import read_start

__all__ = ["ForeignFileError", "require_own", "write_whole"]

_MARK_WITHIN: Final = 4096
"""Bytes from the start in which a file says who wrote it."""


class ForeignFileError(ValueError):
    """A file that the command did not write, where it wants to write one; one line for the user."""


def write_whole(path: Path, content: str | bytes, mode: int = 0o666) -> None:
    """Write a file that appears under its name when it is complete: what was there stays until then.

    Until then it is beside it, as `NAME.part`, or `NAME.2.part` and so on where somebody has such a file already.

    Args:
        path: of the file.
        content: text is written as UTF-8; what that lacks, as bytes of a file's name that are no text, as an escape.
        mode: who may do what with it, less what the umask takes away.

    Raises:
        OSError: it can't be written, and nothing has changed.
    """
    try:
        draft, file = _draft(path, mode)
        try:
            with file:
                file.write(content.encode(errors="backslashreplace") if isinstance(content, str) else content)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                draft.unlink()
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _draft(path: Path, mode: int) -> tuple[Path, IO[bytes]]:
    """A new file beside another one, and its name."""
    for number in itertools.count(1):
        draft = path.with_name(f"{path.name}.part" if number == 1 else f"{path.name}.{number}.part")
        with contextlib.suppress(FileExistsError):
            return draft, os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb")
    raise AssertionError("there is no last number")


def require_own(path: Path, mark: str) -> None:
    """Check that a file is not there yet, or has `mark` near its start: what its writer puts into every such file.

    Raises:
        ForeignFileError: it is another's, or a pipe, a device or a folder.
        OSError: it can't be looked at.
    """
    try:
        path.stat()
    except FileNotFoundError:
        return
    try:
        start = read_start(path, _MARK_WITHIN)
    except ValueError as error:
        raise ForeignFileError(f"{error}: name another one") from None
    if mark.encode() not in start:
        raise ForeignFileError(f"{shown(path)}: is there already, and is no file of this command: name another one")
