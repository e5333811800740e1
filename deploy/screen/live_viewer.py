"""A Rerun viewer beside a run: a window where there is a display, else a page on the loopback interface.

The station serves its recording (`monitor_station.recording.recorder`). The viewer is a process of its own that asks
for it, so it may be slow, stopped or closed as it likes.
"""

from __future__ import annotations

import contextlib
import importlib.util
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Self
from urllib.parse import quote

__all__ = ["LiveViewer", "has_display", "rerun_program", "viewer_command"]

_SERVED_WITHIN_S: Final = 60.0
_POLL_S: Final = 0.1
_LEAVE_S: Final = 3.0


def has_display(environment: Mapping[str, str], platform: str = sys.platform) -> bool:
    """Whether a window can be opened here."""
    return platform in ("darwin", "win32") or bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def viewer_command(rerun: str, port: int, web_port: int | None) -> list[str]:
    """Command of a viewer of the run that is served on `port`: a page on `web_port`, or a window if that is None."""
    source = f"rerun+http://127.0.0.1:{port}/proxy"
    if web_port is None:
        return [rerun, "--port", "auto", "--bind", "127.0.0.1", source]
    return [rerun, "--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(web_port), source]


class LiveViewer:
    """Starts the viewer once the run is served. A context manager: on leaving, a page ends, a window stays open."""

    def __init__(self, port: int, web_port: int | None, log: Path, say: Callable[[str], None]) -> None:
        """Prepare; nothing starts before the context is entered.

        Args:
            port: where the station will serve the recording.
            web_port: where to serve the page; None = open a window.
            log: file for what the viewer prints.
            say: shows a line to the user; called from another thread.
        """
        self._port, self._web_port = port, web_port
        self._log, self._say = log, say
        self._process: subprocess.Popen[bytes] | None = None
        self._left = threading.Event()
        self._thread = threading.Thread(target=self._start, name="live viewer", daemon=True)

    @property
    def pid(self) -> int | None:
        """Process id of the viewer; None before it has started."""
        return None if self._process is None else self._process.pid

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._left.set()
        self._thread.join()
        if self._process is None or self._web_port is None:
            return
        self._process.terminate()
        try:
            self._process.wait(_LEAVE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _start(self) -> None:
        rerun = rerun_program()
        if rerun is None:
            self._say("no viewer: the command `rerun` is not there")
            return
        if not self._served():
            return
        try:
            self._log.parent.mkdir(parents=True, exist_ok=True)
            with self._log.open("wb") as log:
                # A session of its own, so that Ctrl-C in the terminal reaches the run only.
                self._process = subprocess.Popen(
                    viewer_command(rerun, self._port, self._web_port),
                    stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                )  # fmt: skip
        except OSError as error:
            self._say(f"no viewer: {error}")
            return
        if self._web_port is not None:
            source = quote(f"rerun+http://127.0.0.1:{self._port}/proxy", safe="")
            self._say(f"watch it: http://127.0.0.1:{self._web_port}/?url={source}")

    def _served(self) -> bool:
        """Wait until the station serves its recording; False if it does not, or the run is over."""
        deadline = time.monotonic() + _SERVED_WITHIN_S
        while time.monotonic() < deadline and not self._left.wait(_POLL_S):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self._port), timeout=1.0):
                return True
        return False


def rerun_program() -> str | None:
    """Path of Rerun's own program: the command `rerun` is a Python script that would not pass on a signal to it."""
    package = importlib.util.find_spec("rerun_cli")
    for folder in (package.submodule_search_locations or ()) if package else ():
        for name in ("rerun", "rerun.exe"):
            if (Path(folder) / name).exists():
                return str(Path(folder) / name)
    return shutil.which("rerun")
