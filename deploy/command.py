"""What the commands run_local, ctl, study and report share: their parser, their one-line refusals, and their Python.

A command is a script. Any Python may start it, even one without the packages that it needs. Python puts the script's
folder on the path, where the files of this package would be modules of other names. So a command replaces that folder
by the checkout before it imports anything of ours:

    if __name__ == "__main__":
        sys.path[0] = str(Path(__file__).resolve().parent.parent)
        sys.exit(main())
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from bus.excerpt import shown

__all__ = ["ROOT", "Parser", "refuse", "require"]

ROOT: Final = Path(__file__).resolve().parent.parent
"""The checkout."""

NEEDED: Final = (
    "annotated_types", "msgpack", "mypy_extensions", "numpy", "PIL", "pydantic", "rerun", "rich", "scipy",
    "setproctitle", "tomli_w", "yaml", "zenoh",
)  # fmt: skip
"""The modules of the packages that the project depends on (pyproject.toml)."""


_LONGEST: Final = 600
"""Longest refusal in characters."""


class Parser(argparse.ArgumentParser):
    """A command line that says what is wrong with it in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {shown(message, _LONGEST)} (--help lists the options)\n")


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
