"""Where the examples are that come with the emulator: a policy, and a study that compares it."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from deploy.command import Parser

FOLDER: Final = Path(__file__).resolve().parent / "examples"


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, name_of

    return Parser(prog=name_of("examples"), description="List the examples: files to run, to read and to copy.")


def main(arguments: list[str] | None = None) -> int:
    """Print the path of each, and what it is."""
    parser().parse_args(arguments)
    for path in sorted(FOLDER.glob("[!_]*.*")):
        text = path.read_text(encoding="utf-8")
        what = ast.get_docstring(ast.parse(text)) if path.suffix == ".py" else tomllib.loads(text)["title"]
        print(f"{path}\n    {what}")
    return 0
