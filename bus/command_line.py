"""The command line that `python -m world`, `-m medium`, `-m agents` and `-m monitor_station` share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bus.excerpt import shown
from bus.handover import UNFIT, Handover, build, read

__all__ = ["parse", "parser"]


def parser(program: str, description: str) -> argparse.ArgumentParser:
    """A parser with the options that every process needs."""
    made = argparse.ArgumentParser(prog=f"python -m {program}", description=description)
    made.add_argument("--credentials", type=Path, required=True, metavar="FILE", help="login and configuration (JSON)")
    made.add_argument("--connect", metavar="ENDPOINT", help="the router, such as tcp/HOST:7447, if not the file's")
    return made


def parse(
    made: argparse.ArgumentParser, arguments: list[str] | None, **hints: Any
) -> tuple[argparse.Namespace, Handover]:
    """Parse, read the credentials file and build its entries. Bad input ends the process with status 2 and one line.

    Args:
        made: from `parser`, with the process's own options added.
        arguments: the command line; None = this process's.
        hints: type of each entry that the process needs.
    """
    options = made.parse_args(arguments)
    try:
        handover = read(options.credentials, connect=options.connect)
        entries = {name: build(hint, handover.entries.get(name)) for name, hint in hints.items()}
    except UNFIT as error:
        made.exit(2, f"{made.prog}: {shown(options.credentials)}: {shown(error, 300)}\n")
    return options, Handover(handover.login, entries)
