"""Readers of recordings that are under way or were left by a crash."""

from __future__ import annotations

import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import rerun as rr

__all__ = ["readable", "rrd"]


def rrd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Rerun's own tool for recordings."""
    command = [sys.executable, "-m", "rerun", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def readable(path: Path) -> Path:
    """A copy of the file as it is now, repaired if it ends within a message, as it may at any moment."""
    copy, whole = path.with_name("copy.rrd"), path.with_name("whole.rrd")
    shutil.copyfile(path, copy)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # there is no footer
        try:
            rr.chunk.RrdReader(copy).stream()
        except RuntimeError as error:
            if "exceeds file size" not in str(error):
                raise
            repair = rrd("optimize", copy, "-o", whole)
            assert repair.returncode == 0, repair.stderr
            return whole
    return copy
