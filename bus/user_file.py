"""Files that a user names: whatever lies at the path, it is read whole and bounded, or refused in one line."""

from __future__ import annotations

import codecs
import stat
from pathlib import Path

from bus.excerpt import shown

__all__ = ["read_bytes", "read_start", "read_text"]


def read_bytes(path: Path, most: int) -> bytes:
    """A regular file's bytes.

    Raises:
        ValueError: it can't be read, or it has more than `most` bytes.
    """
    data = read_start(path, most + 1)
    if len(data) > most:
        raise ValueError(f"{shown(path)}: larger than {most:,} bytes")
    return data


def read_start(path: Path, most: int) -> bytes:
    """The first bytes of a regular file, `most` at most; a pipe or a device, which may never end, is not opened.

    Raises:
        ValueError: it can't be read.
    """
    try:
        kind = path.stat().st_mode
        if stat.S_ISDIR(kind):
            raise ValueError("a folder, not a file")
        if not stat.S_ISREG(kind):
            raise ValueError("a pipe or a device, not a file")
        with path.open("rb") as file:
            return file.read(most)
    except OSError as error:
        raise ValueError(f"{shown(path)}: {error.strerror}") from None
    except ValueError as error:  # ours, and a name that no file can have
        raise ValueError(f"{shown(path)}: {error}") from None


def read_text(path: Path, most: int, errors: str = "strict") -> str:
    r"""A regular file's text in UTF-8, or in UTF-16 if it begins with that byte order mark; every line ends with \n.

    Args:
        path: of the file.
        most: bytes.
        errors: what to do with bytes that are no text, as `bytes.decode` has it.

    Raises:
        ValueError: it can't be read, has more than `most` bytes, or is no text.
    """
    data = read_bytes(path, most)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{shown(path)}: not a text file: byte {error.start + 1} is not {error.encoding}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")
