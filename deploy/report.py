#!/usr/bin/env python3
"""Make a page about a run, or about two: `deploy/report.py RUN_DIR`, `deploy/report.py --compare RUN_A RUN_B`.

Exit status: 0, or 2 for bad input (one line).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deploy.command import Parser


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, name_of

    p = Parser(
        prog=name_of("report"), description="Make one HTML file about a run: it opens anywhere and loads nothing."
    )
    p.add_argument("run", nargs="?", type=Path, metavar="RUN_DIR", help="folder of a run that has ended")
    p.add_argument("--compare", nargs=2, type=Path, metavar=("RUN_A", "RUN_B"), help="two runs over each other")
    p.add_argument(
        "--out", type=Path, metavar="FILE.html", help="default: RUN_DIR/report.html, or RUN_B/comparison.html"
    )
    return p


def main(arguments: list[str] | None = None) -> int:
    """Write the page; returns the exit status."""
    options = parser().parse_args(arguments)
    if (options.run is None) == (options.compare is None):
        parser().error("expected either RUN_DIR or --compare RUN_A RUN_B")
    from deploy.command import refuse, require

    require("report")
    from bus.excerpt import shown
    from deploy.page.comparison_page import comparison_page
    from deploy.page.html import GENERATOR
    from deploy.page.run_page import report_page
    from deploy.run_folder.reader import RunFilesError, read_run
    from world.own_file import ForeignFileError, require_own, write_whole

    if options.compare is None:
        out = options.out or options.run / "report.html"
    else:
        out = options.out or options.compare[1] / "comparison.html"
    try:
        runs = [read_run(path) for path in options.compare or [options.run]]
        page = report_page(*runs) if options.compare is None else comparison_page(*runs)
        require_own(out, GENERATOR)
        write_whole(out, page)
    except (RunFilesError, ForeignFileError) as error:
        return refuse("report", error)
    except OSError as error:
        return refuse("report", f"{shown(out)}: can't write there: {error.strerror}")
    print(f"report: {out}")
    return 0


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
