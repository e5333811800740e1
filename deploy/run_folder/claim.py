"""Which folder a run may write into: a new or empty one, or an earlier run's if the user says so.

A run never writes beside what a run did not write, and two runs never write into one folder: the lock of its file
`run.lock` is the launcher's and its processes', and goes with the last of them. The file itself stays: it says that the
folder is a run's. Studies do the same (`deploy/sweep/results.py`).
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import fnmatch
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Final

from bus.excerpt import shown

__all__ = ["LOCK", "Claim", "ClaimError", "explained", "new_folder", "refuse_foreign", "take_lock"]

LOCK: Final = "run.lock"
_WRITTEN: Final = (
    LOCK, "scenario.toml", "pids.json*", "operator.json*", "robot-*.json*",
    "summary.json*", "metrics.csv", "events.jsonl", "journal",
    "recording*.rrd", "map.yaml*", "map.pgm*", "report.html*", "comparison.html*", "logs/*.log",
)  # fmt: skip
"""All that a run and its reports write."""
_NO_LOCKS: Final = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""Of file systems that can't lock: there nothing protects a run from another one."""


class ClaimError(ValueError):
    """A folder that a run or a study may not write into; one line for the user."""


def new_folder(parent: Path, name: str) -> Path:
    """Make a folder that was not there before: `parent`/`name`, `name`-2, and so on.

    Raises:
        ClaimError: it can't be made.
    """
    with explained(parent):
        parent.mkdir(parents=True, exist_ok=True)
        number, path = 1, parent / name
        while True:
            with contextlib.suppress(FileExistsError):
                path.mkdir()
                return path
            number += 1
            path = parent / f"{name}-{number}"


class Claim:
    """A run folder that belongs to this process, and to those that it passes `lock` on to, until all have ended."""

    def __init__(self, path: Path, *, overwrite: bool = False, reads: Sequence[Path] = ()) -> None:
        """Take a folder, which is empty but for the lock when this returns.

        Args:
            path: of the folder. It is made if it is not there.
            overwrite: whether an earlier run's files are removed from it.
            reads: files and folders that the run reads: they must not be among those.

        Raises:
            ClaimError: it can't be taken, and nothing in it was changed.
        """
        self._path = path
        with explained(path):
            self._made = not path.exists()
            path.mkdir(parents=True, exist_ok=True)
            self._was_marked = (path / LOCK).exists()
            refuse_foreign(path, _WRITTEN, "run", marked=self._was_marked)
            try:
                self.lock = take_lock(path / LOCK)
            except OSError:
                self._remove_if_made()
                raise
            try:
                refuse_foreign(path, _WRITTEN, "run", marked=True)
                self._refuse_earlier(overwrite, reads)
                self._clear()
            except BaseException:
                self._give_up()
                raise

    def release(self) -> None:
        """Let another run have the folder, as soon as no process holds it any more."""
        if not self.lock.closed:
            self.lock.truncate(0)
        self.lock.close()

    def undo(self) -> None:
        """Release it as it was found, but for an earlier run: for one that could not even begin."""
        with contextlib.suppress(OSError):
            self._clear()
        self._give_up()

    def _give_up(self) -> None:
        if not self._was_marked:
            with contextlib.suppress(OSError):
                (self._path / LOCK).unlink()
        self._remove_if_made()
        self.release()

    def _remove_if_made(self) -> None:
        if self._made:
            with contextlib.suppress(OSError):
                self._path.rmdir()

    def _refuse_earlier(self, overwrite: bool, reads: Sequence[Path]) -> None:
        if all(path.name == LOCK for path in self._path.iterdir()):
            return
        if not overwrite:
            raise ClaimError("holds an earlier run: --overwrite replaces it")
        here = self._path.resolve()
        for path in reads:
            if here in (path.resolve(), path.resolve().parent):
                raise ClaimError(f"this run reads {shown(path)}")

    def _clear(self) -> None:
        for path in self._path.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            elif path.name != LOCK:
                path.unlink()


def refuse_foreign(folder: Path, written: Sequence[str], writer: str, *, marked: bool) -> None:
    """Check that a folder holds nothing but what a certain writer writes.

    Args:
        folder: to look into.
        written: patterns of all that it writes: names, and `folder/name` for those in a folder of its own.
        writer: of what kind it is, for the message.
        marked: whether the folder is known to be such a writer's. If it is not, it must be empty.

    Raises:
        ClaimError: it holds something else.
    """
    inner = {pattern.partition("/")[0] for pattern in written if "/" in pattern}
    for path in sorted(folder.iterdir()):
        within = path.name in inner and path.is_dir() and not path.is_symlink()
        names = [f"{path.name}/{each.name}" for each in sorted(path.iterdir())] if within else [path.name]
        for name in names if marked else [path.name]:
            if not marked or not any(fnmatch.fnmatchcase(name, pattern) for pattern in written):
                raise ClaimError(f"holds {shown(name)}, which no {writer} wrote: name a new or an empty folder")


def take_lock(path: Path) -> IO[bytes]:
    """Lock a file, which is made if need be, for as long as what this returns stays open here or in a process.

    Raises:
        ClaimError: somebody else has the lock.
        OSError: it can't be made.
    """
    lock = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644), "r+b")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not path.exists() or path.stat().st_ino != os.fstat(lock.fileno()).st_ino:
            raise BlockingIOError  # somebody else has removed it meanwhile
    except BlockingIOError:
        pid = lock.read(20).decode(errors="replace").strip()
        lock.close()
        raise ClaimError(f"a {path.stem} is under way there{f' (pid {pid})' if pid else ''}") from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            lock.close()
            raise
    with contextlib.suppress(OSError):  # a hint for others, no more
        lock.truncate(0)
        os.write(lock.fileno(), f"{os.getpid()}\n".encode())
    return lock


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Put a folder's name before a `ClaimError`, and make an `OSError` one."""
    try:
        yield
    except ClaimError as error:
        raise ClaimError(f"{shown(path)}: {error}") from None
    except OSError as error:
        raise ClaimError(f"{shown(path)}: can't write there: {error.strerror}") from None
