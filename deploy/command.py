"""What the commands run_local, ctl, study, report and whatif share: names, parser, one-line refusals, and their Python.

Each is a script of a checkout, and a verb of the command `vds` (vds/__main__.py), by the same `main`. Any Python may
start a script, even one without the packages that it needs. Python puts the script's folder on the path, where the
files of this package would be modules of other names. So a script replaces that folder by the checkout before it
imports anything of ours:

    if __name__ == "__main__":
        sys.path[0] = str(Path(__file__).resolve().parent.parent)
        from deploy.command import entry

        entry(main)
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NoReturn

from bus.built import INSTALLED
from bus.excerpt import shown
from bus.numerals import decimal, whole
from deploy.machine.interrupts import SIGNALS
from deploy.machine.outlet import keep_writing, lost

__all__ = [
    "INTERRUPTED", "ROOT", "Parser", "a_number", "a_whole_number", "by_vds", "call_of", "entry", "name_of", "refuse",
    "require", "way_to_extra",
]  # fmt: skip

ROOT: Final = Path(__file__).resolve().parent.parent
"""The checkout, or the folder of installed packages."""

SCRIPTS: Final = {
    "run": "run_local.py",
    "ctl": "ctl.py",
    "report": "report.py",
    "study": "study.py",
    "whatif": "whatif.py",
}
"""By verb of `vds`: the script in deploy/ that does the same."""

_by_vds = INSTALLED  # its users know no scripts

NEEDED: Final = (
    "annotated_types", "msgpack", "mypy_extensions", "numpy", "PIL", "pydantic", "rerun", "rich", "scipy",
    "setproctitle", "tomli_w", "yaml", "zenoh",
)  # fmt: skip
"""The modules of the packages that the project depends on (pyproject.toml)."""

INTERRUPTED: Final = 130
"""Exit status of a command that was interrupted before it came to a result."""


_LONGEST: Final = 600
"""Longest refusal in characters."""


def by_vds() -> None:
    """From now on all hints name the command `vds`."""
    global _by_vds
    _by_vds = True


def name_of(verb: str) -> str:
    """What a command calls itself: `run_local.py`, or `vds run`."""
    return SCRIPTS[verb] if verb in SCRIPTS and not _by_vds else f"vds {verb}"


def call_of(verb: str) -> str:
    """How its user calls a command: `deploy/run_local.py`, seen from the checkout, or `vds run`."""
    return f"deploy/{SCRIPTS[verb]}" if verb in SCRIPTS and not _by_vds else f"vds {verb}"


class Parser(argparse.ArgumentParser):
    """A command line that says what is wrong with it in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {shown(message, _LONGEST)} (--help lists the options)\n")


def a_whole_number(text: str) -> int:
    """Type of an option's value."""
    try:
        return whole(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{shown(text)}' is {error}") from None


def a_number(text: str) -> float:
    """Type of an option's value."""
    try:
        return decimal(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{shown(text)}' is {error}") from None


def entry(main: Callable[[], int], name: str | None = None) -> NoReturn:
    """Run a command to its exit status, whatever becomes of the terminal, the pipe or the disk that it writes to.

    Args:
        main: the command.
        name: what it calls itself; None: by its script.
    """
    _use_utf_8()
    keep_writing()
    script = name or Path(sys.argv[0]).name
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # by nohup
            signal.signal(number, signal.default_int_handler)
    status: object = INTERRUPTED
    try:
        status = main()
    except SystemExit as end:
        status = end.code
    except KeyboardInterrupt:
        print(f"{script}: interrupted", file=sys.stderr)
    # The status is settled: a signal that comes late must not replace it.
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    for stream, why in lost().items():
        print(f"{script}: {stream} could not be written: {why}", file=sys.stderr)
        status = status or 1
    sys.exit(status)  # type: ignore[arg-type]  # what SystemExit holds


def _use_utf_8() -> None:
    """Go on in Python's UTF-8 mode where the locale has another encoding, which lacks letters of names and files."""
    if sys.getfilesystemencoding() != "utf-8":
        os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


def refuse(verb: str, problem: object) -> int:
    """Say in one line why a command can't be carried out; returns its exit status, 2."""
    print(f"{name_of(verb)}: {shown(' '.join(str(problem).split()), _LONGEST)}", file=sys.stderr)
    return 2


def way_to_extra(extra: str = "study") -> str:
    """How to get the packages of an extra of pyproject.toml."""
    return f"`{sys.executable} -m pip install 'vds-emulator[{extra}]'`" if INSTALLED else "run `make setup`"


def require(verb: str, also: Sequence[str] = ()) -> None:
    """Return if this Python has all that the project needs; else go on in the project's own, or exit with status 2.

    Args:
        verb: of the command that is running.
        also: further modules that it needs, of the extra `study`.
    """
    missing = [name for name in (*NEEDED, *also) if importlib.util.find_spec(name) is None]
    if not missing:
        from bus.built import complaint

        if complaint():
            refuse(verb, complaint())
            sys.exit(2)
        return
    if INSTALLED:
        way = way_to_extra() if set(missing) <= set(also) else "install vds-emulator again"
        refuse(verb, f"this Python lacks {', '.join(missing)}: {way}")
        sys.exit(2)
    venv = ROOT / ".venv"
    program = ["-m", "vds"] if _by_vds else [str(ROOT / "deploy" / SCRIPTS[verb])]
    if (venv / ".installed").exists() and Path(sys.prefix).resolve() != venv.resolve():
        python = str(venv / "bin" / "python")
        os.execv(python, [python, *program, *sys.argv[1:]])
    then = f".venv/bin/vds {verb}" if _by_vds else f".venv/bin/python {call_of(verb)}"
    refuse(verb, f"this Python lacks {', '.join(missing)}: run `make setup` in {ROOT}, then `{then}`")
    sys.exit(2)
