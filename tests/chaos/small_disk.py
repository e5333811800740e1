"""A disk with little room: a file system in memory where this user may mount one, else a limit of file sizes."""

from __future__ import annotations

import contextlib
import resource
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["limited", "small_disk"]


@contextlib.contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[bool]:
    """Let `folder` lie on a disk of its own; False, and nothing is done, if that is not allowed here."""
    words = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "chaos", str(folder)]
    mounted = subprocess.run(words, capture_output=True, check=False).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            # Lazily: should a process hold a file there, that is a finding and no reason to leave the mount.
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


def limited(kilobytes: int) -> Callable[[], None]:
    """What a process does first to be allowed files of so many kilobytes only."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes * 1024, kilobytes * 1024))
