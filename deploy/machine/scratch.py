"""A process's temporary folder: sockets, and files of a moment. It goes with the process, whatever ends that one.

Who removes it is a janitor, a shell that waits for the end of a pipe which only this process holds. Should both be
killed, the next process that makes such a folder sweeps the old one away: nobody holds its lock any more.
"""

from __future__ import annotations

import contextlib
import fcntl
import multiprocessing
import os
import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, Self

from bus.excerpt import shown

__all__ = ["Scratch", "ScratchError", "home_of_tempfile"]

_PREFIX: Final = "vds-"
_RANDOM: Final = 12
"""Characters of a name behind the prefix."""
_LOCK: Final = ".vds-scratch"
_JANITOR: Final = 'read _; exec rm -rf -- "$@"'
_LONGEST: Final = 66
"""Bytes of the folder around it. A socket's path may have 107: ours and multiprocessing's take 40 at most."""


class ScratchError(Exception):
    """Such a folder can't be made; one line for the user."""


class Scratch:
    """`path` is a folder that only this user may enter. A context manager: on leaving it is gone."""

    def __init__(self, also: Sequence[Path] = ()) -> None:
        """Make it.

        Args:
            also: further files that go with it.

        Raises:
            ScratchError: there is no room for it.
        """
        base = _base()
        _sweep(base)
        self.path = base / f"{_PREFIX}{secrets.token_hex(_RANDOM // 2)}"
        with contextlib.ExitStack() as held:
            try:
                self._make(also, held)
            except OSError as error:
                raise ScratchError(f"{shown(base)}: no temporary folder can be made there: {error.strerror}") from error
            self._held = held.pop_all()

    def close(self) -> None:
        """Remove it."""
        self._held.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _make(self, also: Sequence[Path], held: contextlib.ExitStack) -> None:
        draft = self.path.with_suffix(".new")
        held.enter_context(_janitor([self.path, draft, *also]))
        draft.mkdir(mode=0o700)
        lock = held.enter_context((draft / _LOCK).open("wb"))
        fcntl.flock(lock, fcntl.LOCK_EX)
        # A sweeper finds it by this name, so not before it is locked.
        draft.rename(self.path)


@contextlib.contextmanager
def _janitor(doomed: Sequence[Path]) -> Iterator[None]:
    """Remove files and folders on leaving, or as soon as this process is gone."""
    # A session of its own: what is sent to a whole terminal or process group is not for it.
    janitor = subprocess.Popen(
        ["/bin/sh", "-c", _JANITOR, "vds janitor", *doomed], cwd="/", stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield
    finally:
        # A line, too: a process that was forked from this one may hold the pipe.
        janitor.communicate(b"\n")


def _base() -> Path:
    """The folder around it: what TMPDIR says, unless the path of a socket would become too long there.

    Raises:
        ScratchError: no folder will do.
    """
    tried = []
    with contextlib.suppress(FileNotFoundError):  # no folder for temporary files at all
        tried.append(tempfile.gettempdir())
    for name in (*tried, "/tmp", "/var/tmp", "/dev/shm"):
        if len(os.fsencode(name)) <= _LONGEST and os.access(name, os.W_OK | os.X_OK):
            return Path(name)
    why = f"{tried[0]} has more than {_LONGEST} characters and" if tried else "TMPDIR and"
    raise ScratchError(f"no folder for the sockets of a run: {why} /tmp can't be used")


def _sweep(base: Path) -> None:
    """Remove the folders of processes that are gone together with their janitors."""
    for lock in base.glob(f"{_PREFIX}{'[0-9a-f]' * _RANDOM}/{_LOCK}"):
        with contextlib.suppress(OSError), lock.open("rb") as held:  # busy, gone meanwhile, or another user's
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(lock.parent, ignore_errors=True)


@contextlib.contextmanager
def home_of_tempfile(path: Path) -> Iterator[None]:
    """Let `tempfile` and multiprocessing put everything there."""
    before = tempfile.tempdir
    # There is no public name for it; left to itself, multiprocessing would want to remove a folder of its own at exit.
    config: dict[str, object] = getattr(multiprocessing.current_process(), "_config")  # noqa: B009  # not declared
    tempfile.tempdir = config["tempdir"] = str(path)
    try:
        yield
    finally:
        tempfile.tempdir = before
        del config["tempdir"]
