"""Whose code an exception comes from: the innermost line that is neither ours, nor Python's, nor a package's."""

from __future__ import annotations

import sysconfig
import traceback
from types import TracebackType
from typing import Final

__all__ = ["culprit", "from_users_code"]

_ROOT: Final = __file__.removesuffix(__name__.replace(".", "/") + __file__[__file__.rindex(".") :])
_OURS: Final = tuple(
    f"{_ROOT}{package}/" for package in ("bus", "world", "medium", "agents", "monitor_station", "deploy")
)
_PYTHON: Final = f"{sysconfig.get_path('stdlib')}/"


def culprit(error: BaseException) -> str:
    """`FILE, line N` in the user's code, or in the file that Python could not read; empty where there is neither."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if _is_users(frame.filename)]
    return f"{frames[-1].filename}, line {frames[-1].lineno}" if frames else ""


def from_users_code(error: BaseException) -> TracebackType | None:
    """The traceback from the first line of the user's code on; the whole where there is none."""
    at = error.__traceback__
    while at is not None and not _is_users(at.tb_frame.f_code.co_filename):
        at = at.tb_next
    return at or error.__traceback__


def _is_users(file: str) -> bool:
    # What is compiled has a relative path, and what has no file has none.
    return file.startswith("/") and not file.startswith((*_OURS, _PYTHON)) and "/site-packages/" not in file
