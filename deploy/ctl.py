#!/usr/bin/env python3
"""Speak to a run that is under way: `deploy/ctl.py status`, `deploy/ctl.py kill 4`, `deploy/ctl.py speed 10`."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from bus.session import Mailbox, Session
    from deploy.command import Parser

COMMANDS: Final = """\
commands:
  status                  time, pace, robots and progress
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


VERBS: Final = "status, kill, pause, restart, jam, loss, hold, step, go, speed and interrupt"
_FAULTS: Final = ("kill", "pause", "restart", "jam", "loss")
_DONE: Final = {"kill": "killed", "pause": "paused", "restart": "restarted"}
_ACTS_WITHIN_S: Final = 5.0
"""Wall time to wait for what a fault does: it acts at the next tick."""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, call_of, name_of

    p = Parser(
        prog=name_of("ctl"), description=f"Speak to a run that is under way, such as `{call_of('ctl')} kill 4`.",
        epilog=COMMANDS, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    p.add_argument("--run", type=Path, metavar="DIR", help="run folder (default: of the one run under way)")
    p.add_argument("--json", action="store_true", help="print the run's whole answer")
    p.add_argument("command", nargs="*", help="see below")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Ask one thing of a run; returns 0, 1 if it refused or did nothing, 2 if it is not clear what or whom to ask."""
    from deploy.command import ROOT, refuse, require

    options = parser().parse_args(arguments)
    if not options.command:
        return refuse("ctl", f"which command? There are {VERBS} (--help says more)")
    require("ctl")
    from bus.excerpt import shown
    from bus.session import BusError, Session
    from deploy.processes.operator_file import read_operator

    found = runs_under_way([Path("runs"), ROOT / "runs"]) if options.run is None else [options.run]
    if not found:
        return refuse("ctl", "no run is under way here: name its folder by --run")
    if len(found) > 1:
        return refuse("ctl", f"{len(found)} runs are under way: name one by --run: {', '.join(map(str, found))}")
    folder = found[0]
    try:
        login = read_operator(folder)
    except ValueError as error:
        return refuse("ctl", f"no run is under way in {folder}: {error}")
    try:
        session = Session.connect(login, watching=True, timeout_s=5.0)
        try:
            told = asked(session, options.command)
        finally:
            session.close()
    except BusError as error:
        return refuse("ctl", f"the run in {folder} does not answer: {error}")
    return show(told, options.command, shown(folder.resolve().name, 80), whole=options.json)


def question(words: list[str]) -> str:
    """The command in the world's form: a fault as the option --fault takes it, at time 0, which means now."""
    match words:
        case ["kill", target]:
            return f"fault kill:{target}@0"
        case ["pause" | "restart" | "jam" | "loss" as verb, target, duration_s]:
            return f"fault {verb}:{target}@0+{duration_s}"
        case _:
            return " ".join(words)


def runs_under_way(folders: list[Path]) -> list[Path]:
    """The run folders of all runs that are under way, the newest first."""
    from deploy.processes.operator_file import OPERATOR, living_launcher

    found = {
        file.parent.resolve(): file for folder in folders for file in folder.glob(f"*/{OPERATOR}")
        if living_launcher(file.parent)
    }  # fmt: skip
    return [file.parent for file in sorted(found.values(), key=lambda file: file.stat().st_mtime, reverse=True)]


def asked(session: Session, words: list[str]) -> str:
    """The run's answer, JSON; to a fault with the event of what it did, unless the run is held."""
    from bus.session import Mailbox

    control = session.keys.control
    if words[0] not in _FAULTS:
        return session.ask(control, question(words))
    events = Mailbox()
    session.subscribe(events, session.keys.event)
    held = object_in(session.ask(control, "status")).get("held")
    answer = session.ask(control, question(words))
    told = object_in(answer)
    if "fault" not in told or held:
        return answer
    acted = _acted(events, str(told["fault"]).rpartition("@")[0])
    return answer if acted is None else json.dumps(told | {"acted": acted})


def _acted(events: Mailbox, fault: str) -> dict[str, Any] | None:
    """What a fault did, without its time: the event that tells of it; None if there is none in time."""
    from bus.codec import WireError
    from world.feed import Event
    from world.terms import seconds_of

    deadline = time.monotonic() + _ACTS_WITHIN_S
    while (left_s := deadline - time.monotonic()) > 0:
        message = events.get(left_s)
        if message is None or message[1] is None:
            continue
        with contextlib.suppress(WireError):
            event = Event.decode(message[1])
            if event.kind == "fault" and event.text.startswith(f"{fault}@"):
                return {
                    "at_s": seconds_of(event.tick),
                    "node": event.node,
                    "text": event.text,
                    "done": bool(event.data),
                }
    return None


def object_in(answer: str) -> dict[str, Any]:
    """The object that an answer is; an empty one if it is none."""
    try:
        told = json.loads(answer)
    except (ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def show(answer: str, words: list[str], run: str, *, whole: bool) -> int:
    """Print an answer to a command: whole as JSON, or what it comes to, in a line; returns the exit status."""
    from bus.excerpt import shown
    from deploy.command import name_of

    told = object_in(answer)
    if "error" in told:
        print(f"{name_of('ctl')}: {shown(told['error'], 300)}", file=sys.stderr)
        return 1
    try:
        line = json.dumps(told, indent=1) if whole else _said(told, words, run)
    except (ArithmeticError, KeyError, TypeError, ValueError):  # no answer of this version's
        line = shown(answer, 300)
    print(line)
    acted = told.get("acted")
    return 1 if isinstance(acted, dict) and not acted.get("done") else 0


def _said(told: Mapping[str, Any], words: Sequence[str], run: str) -> str:
    """What an answer comes to."""
    if words == ["status"]:
        return "\n".join(f"{name:<10} {value}" for name, value in _table(told, run))
    if "acted" in told:
        return f"{told['acted']['at_s']} s: {_deed(told['acted'], words)}, run {run}"
    return f"{told['tick'] / 10:.1f} s: {_pace(told, words)}, run {run}"


def _deed(acted: Mapping[str, Any], words: Sequence[str]) -> str:
    """What a fault did, such as "killed robot 4 (relay:mid)"."""
    from bus.excerpt import shown
    from bus.nodes import node_name

    verb, node = words[0], acted.get("node")
    if not acted.get("done") or verb not in _DONE or not isinstance(node, int) or node < 0:
        return shown(acted.get("text"), 200)
    name = node_name(node)
    role = "" if words[1] in (name, str(node), "station") else f" ({shown(words[1], 40)})"
    return f"{_DONE[verb]} {name}{role}" + (f" for {shown(words[2], 40)} s" if len(words) > 2 else "")


def _pace(told: Mapping[str, Any], words: Sequence[str]) -> str:
    """What becomes of the pace of a run, or of a fault that has not acted yet."""
    from bus.excerpt import shown

    if "fault" in told:
        return f"{shown(' '.join(words), 100)} acts at the next tick"
    if told.get("interrupted"):
        return "ends"
    if words[0] == "step":
        return f"{shown(words[1] if len(words) > 1 else 1, 20)} tick(s), then held"
    speed = told.get("speed")
    return (
        "held"
        if told.get("held")
        else "goes on "
        + ("as fast as it can" if speed == "max" else f"at {shown(speed, 20)} simulated seconds a second")
    )


def _table(told: Mapping[str, Any], run: str) -> list[tuple[str, str]]:
    """How a run stands, by name."""
    from bus.excerpt import shown

    rates, robots, waiting = (told.get(key) or [] for key in ("search_rate", "robots", "waiting_for"))
    return [
        ("run", run),
        ("simulated", f"{told['tick'] / 10:.1f} s"),
        ("pace", _pace(told, ["status"])),
        ("robots", shown(", ".join(map(str, robots)), 300) or "none"),
        ("searched", " ".join(f"{rate:.0%}" for rate in rates) or "nothing yet"),
        ("waits for", shown(", ".join(map(str, waiting)), 300) or "nobody"),
    ]


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
