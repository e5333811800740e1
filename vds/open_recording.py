"""Look at the recording of a run: in Rerun's viewer where there is a display, else as a page for a browser."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    from deploy.command import Parser


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, name_of

    p = Parser(prog=name_of("open"), description="Look at the recording of a run.")
    p.add_argument("run", nargs="?", type=Path, metavar="RUN_DIR", help="default: the newest folder of runs/ with one")
    p.add_argument("--web", action="store_true", help="serve a page, as is done without a display")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Become the viewer; returns only if that can't be."""
    from bus.excerpt import shown
    from bus.session import free_endpoint, port_of
    from deploy.command import refuse
    from deploy.screen.live_viewer import has_display, rerun_program

    options = parser().parse_args(arguments)
    folder = options.run or newest(Path("runs"))
    if folder is None:
        return refuse("open", "no run in runs/ has a recording: name the folder of one")
    files = recordings(folder)
    if not files:
        return refuse("open", f"{shown(folder)}: no recording.rrd there")
    words = list(map(str, files))
    if options.web or not has_display(os.environ):
        page, served = port_of(free_endpoint()), port_of(free_endpoint())
        source = quote(f"rerun+http://127.0.0.1:{served}/proxy", safe="")
        print(f"watch it: http://127.0.0.1:{page}/?url={source} (Ctrl-C ends it)", flush=True)
        words += ["--serve-web", "--bind", "127.0.0.1", "--port", str(served), "--web-viewer-port", str(page)]
    program = rerun_program()
    if program is not None:
        os.execv(program, [program, *words])
    return refuse("open", "the viewer is not there: install rerun-sdk")


def recordings(folder: Path) -> list[Path]:
    """The parts of a run's recording: one, and one more for each restart of the station."""
    return sorted(folder.glob("recording*.rrd"))


def newest(runs: Path) -> Path | None:
    """The run folder that changed last, of those with a recording."""
    found = [folder for folder in runs.glob("*") if recordings(folder)]
    return max(found, key=lambda folder: folder.stat().st_mtime) if found else None
