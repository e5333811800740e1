"""Lets a script run under any Python: it goes on in the project's own environment, or says how to make one."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

__all__ = ["require"]

ROOT: Final = Path(__file__).resolve().parent.parent


def require(script: Path, modules: Sequence[str]) -> None:
    """Return if this Python has the modules; else run `script` again by the project's Python, or exit with status 2."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if not missing:
        return
    venv = ROOT / ".venv"
    if (venv / ".installed").exists() and Path(sys.prefix).resolve() != venv.resolve():
        python = str(venv / "bin" / "python")
        os.execv(python, [python, str(script.resolve()), *sys.argv[1:]])
    print(
        f"{script.name}: this Python lacks {', '.join(missing)}: run `make setup` in {ROOT}, "
        f"then `.venv/bin/python deploy/{script.name}`",
        file=sys.stderr,
    )
    sys.exit(2)
