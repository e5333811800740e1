#!/usr/bin/env python3
"""Speak to a run that is under way: `deploy/ctl.py status`, `deploy/ctl.py kill 4`, `deploy/ctl.py speed 10`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from deploy.command import Parser

COMMANDS: Final = """\
commands:
  status                  tick, speed, roster and progress, as JSON
  kill NODE               SIGKILL, for good
  pause NODE S            SIGSTOP, and SIGCONT after S simulated seconds
  restart NODE S          SIGKILL, and a new process after S simulated seconds
  jam A,B S               robots A and B do not hear each other for S simulated seconds
  jam X0,Y0,X1,Y1 S       nobody in that region hears anything for S simulated seconds
  loss P S                every frame is lost with probability P for S simulated seconds
  hold | step [N] | go    hold the run; N ticks (or one), then hold; go on
  speed F                 go on at F simulated seconds per second (max: as fast as possible)
  interrupt               end the run
NODE is a robot's id, `station`, or a role such as relay:mid.
"""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, call_of, name_of

    p = Parser(
        prog=name_of("ctl"), description=f"Speak to a run that is under way, such as `{call_of('ctl')} kill 4`.",
        epilog=COMMANDS, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    p.add_argument("--run", type=Path, metavar="DIR", help="run folder (default: the newest run under way)")
    p.add_argument("command", nargs="+", help="see below")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Ask one thing of a run; returns 0, 1 if the run refused, 2 if there is no such run."""
    from deploy.command import ROOT, refuse, require

    options = parser().parse_args(arguments)
    require("ctl")
    from bus.session import BusError, Session
    from deploy.processes.operator_file import read_operator

    folder = options.run or newest_run([Path("runs"), ROOT / "runs"])
    if folder is None:
        return refuse("ctl", "no run is under way here: name its folder by --run")
    try:
        login = read_operator(folder)
    except ValueError as error:
        return refuse("ctl", f"no run is under way in {folder}: {error}")
    try:
        session = Session.connect(login, watching=True, timeout_s=5.0)
        try:
            answer = session.ask(session.keys.control, question(options.command))
        finally:
            session.close()
    except BusError as error:
        return refuse("ctl", f"the run in {folder} does not answer: {error}")
    return _show(answer)


def question(words: list[str]) -> str:
    """The command in the world's form: a fault as `run_local.py --fault` takes it, at time 0, which means now."""
    match words:
        case ["kill", target]:
            return f"fault kill:{target}@0"
        case ["pause" | "restart" | "jam" | "loss" as verb, target, duration_s]:
            return f"fault {verb}:{target}@0+{duration_s}"
        case _:
            return " ".join(words)


def newest_run(folders: list[Path]) -> Path | None:
    """The run folder of the newest run that is under way."""
    from deploy.processes.operator_file import OPERATOR, living_launcher

    found = [file for folder in folders for file in folder.glob(f"*/{OPERATOR}") if living_launcher(file.parent)]
    return max(found, key=lambda file: file.stat().st_mtime).parent if found else None


def _show(answer: str) -> int:
    from deploy.command import name_of

    try:
        told = json.loads(answer)
    except (ValueError, RecursionError):
        told = answer
    if isinstance(told, dict) and "error" in told:
        print(f"{name_of('ctl')}: {told['error']}", file=sys.stderr)
        return 1
    print(told if isinstance(told, str) else json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
