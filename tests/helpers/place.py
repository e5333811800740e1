"""A folder for the temporary files of a run or a study, by which its processes are found again."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from tests.helpers.waiting import alive, wait_until

__all__ = ["Place"]


class Place:
    """Whoever was started with this folder as TMPDIR, or holds a file in it or in a run folder open."""

    def __init__(self, path: Path, *run_folders: Path) -> None:
        """Watch a folder for temporary files, and folders that the runs write into."""
        self.path = path
        self.environment = {"TMPDIR": str(path)}
        self._folders = tuple(f"{folder.resolve()}/" for folder in (path, *run_folders))

    def names(self) -> set[str]:
        """All that is in it: names of files without those of folders, which are made up."""
        # A folder may be renamed while one looks: `os.walk` passes over it.
        return {name.partition("-")[0] for _, folders, files in os.walk(self.path) for name in (*folders, *files)}

    def processes(self) -> list[int]:
        """Processes of the run, whatever became of their parents."""
        return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit() and self._is_ours(path)]

    def janitors(self) -> list[int]:
        found = []
        for pid in self.processes():
            with contextlib.suppress(OSError):  # it has ended since
                if b"vds janitor" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(pid)
        return found

    def assert_clean(self) -> None:
        wait_until(lambda: not self.processes(), "no process is left")
        assert not list(self.path.iterdir())

    def _is_ours(self, process: Path) -> bool:
        with contextlib.suppress(OSError):
            told = f"TMPDIR={self.path}".encode() in (process / "environ").read_bytes().split(b"\0")
            # The title of a process of a run covers its environment; its log is open, though.
            if told or any(self._is_in_folder(descriptor) for descriptor in (process / "fd").iterdir()):
                return alive(int(process.name))
        return False

    def _is_in_folder(self, descriptor: Path) -> bool:
        with contextlib.suppress(OSError):
            return str(descriptor.readlink()).startswith(self._folders)
        return False
