"""What the commands share (run_local, ctl, study, report, whatif): parser, one-line refusals, and their Python.

A command is a script. Any Python may start it, even one without the packages that it needs. Python puts the script's
folder on the path, where the files of this package would be modules of other names. So a command replaces that folder
by the checkout before it imports anything of ours:

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

from bus.excerpt import shown
from bus.numerals import decimal, whole
from deploy.machine.interrupts import SIGNALS
from deploy.machine.outlet import keep_writing, lost

__all__ = ["INTERRUPTED", "ROOT", "Parser", "a_number", "a_whole_number", "entry", "refuse", "require"]

ROOT: Final = Path(__file__).resolve().parent.parent
"""The checkout."""

NEEDED: Final = (
    "annotated_types", "msgpack", "mypy_extensions", "numpy", "PIL", "pydantic", "rerun", "rich", "scipy",
    "setproctitle", "tomli_w", "yaml", "zenoh",
)  # fmt: skip
"""The modules of the packages that the project depends on (pyproject.toml)."""

INTERRUPTED: Final = 130
"""Exit status of a command that was interrupted before it came to a result."""


_LONGEST: Final = 600
"""Longest refusal in characters."""


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


def entry(main: Callable[[], int]) -> NoReturn:
    """Run a command to its exit status, whatever becomes of the terminal, the pipe or the disk that it writes to."""
    _use_utf_8()
    keep_writing()
    script = Path(sys.argv[0]).name
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


def refuse(script: str, problem: object) -> int:
    """Say in one line why a command can't be carried out; returns its exit status, 2."""
    print(f"{script}: {shown(' '.join(str(problem).split()), _LONGEST)}", file=sys.stderr)
    return 2


def require(script: Path, also: Sequence[str] = ()) -> None:
    """Return if this Python has all that the project needs; else go on in the project's own, or exit with status 2.

    Args:
        script: the command that is running.
        also: further modules that it needs.
    """
    missing = [name for name in (*NEEDED, *also) if importlib.util.find_spec(name) is None]
    if not missing:
        from bus.built import complaint

        if complaint():
            refuse(script.name, complaint())
            sys.exit(2)
        return
    venv = ROOT / ".venv"
    if (venv / ".installed").exists() and Path(sys.prefix).resolve() != venv.resolve():
        python = str(venv / "bin" / "python")
        os.execv(python, [python, str(script.resolve()), *sys.argv[1:]])
    refuse(
        script.name,
        f"this Python lacks {', '.join(missing)}: run `make setup` in {ROOT}, "
        f"then `.venv/bin/python deploy/{script.name}`",
    )
    sys.exit(2)
