"""The command `vds`: one verb for each thing that a user does. `python -m vds` is the same.

Nothing is imported here but the standard library: every process of a run imports the module that began it.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from deploy.command import Parser

VERBS: Final = MappingProxyType({
    "run": ("deploy.run_local", "run a scenario, one process per robot"),
    "ctl": ("deploy.ctl", "speak to a run that is under way: status, kill, pause, hold, speed, ..."),
    "open": ("vds.open_recording", "look at the recording of a run"),
    "report": ("deploy.report", "make a page about a run, or about two"),
    "study": ("deploy.study", "run many runs, and draw their results"),
    "whatif": ("deploy.whatif", "let every robot fail at every moment, and see what that costs"),
    "scenario": ("vds.show_scenario", "the scenarios that ship, and every key that one can have"),
    "examples": ("vds.show_examples", "where the examples are"),
    "completion": ("vds.completion", "let a shell complete this command"),
})  # fmt: skip
"""By verb: the module with its `parser` and its `main`, and what it does."""


def parser() -> Parser:
    """The whole command line; each verb parses its own words with the same."""
    from deploy.command import Parser

    p = Parser(prog="vds", description="The VDS emulator: a multi-robot victim search, one process per robot.")
    p.add_argument("--version", action="version", version=f"vds {importlib.metadata.version('vds-emulator')}")
    verbs = p.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb, (module, words) in VERBS.items():
        whole = importlib.import_module(module).parser()
        verbs.add_parser(verb, parents=[whole], add_help=False, help=words, description=whole.description)
    return p


def main(arguments: list[str] | None = None) -> int:
    """Do what a verb says; returns the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in VERBS:
        status: int = importlib.import_module(VERBS[words[0]][0]).main(words[1:])
        return status
    parser().parse_args(words)
    return 0


def enter() -> None:
    """The command itself."""
    from vds.packages import ShadowedError, require_ours

    try:
        require_ours()
    except ShadowedError as error:
        print(f"vds: {error}", file=sys.stderr)
        sys.exit(2)
    from deploy.command import by_vds, entry

    by_vds()
    entry(main, "vds")


if __name__ == "__main__":
    # Python put the working folder there, which may have packages of the same names.
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    enter()
