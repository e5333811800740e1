"""The scenarios that come with the emulator, and every key that a scenario can have."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deploy.command import Parser


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, name_of

    p = Parser(
        prog=name_of("scenario"),
        description="Without a name, list the scenarios that ship; with one, print its file, to be copied.",
    )
    one = p.add_mutually_exclusive_group()
    one.add_argument("name", nargs="?", help="of a scenario that ships")
    one.add_argument("--schema", action="store_true", help="JSON Schema of a scenario, by which editors complete TOML")
    one.add_argument("--keys", action="store_true", help="table of every key: default, unit, bounds (Markdown)")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Print what is asked for; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import refuse, require

    require("scenario")
    from deploy.scenario import ScenarioError, names
    from deploy.scenario.files import text_of
    from deploy.scenario.keys_page import keys_page
    from deploy.scenario.schema import schema

    if options.schema:
        print(json.dumps(schema(), indent=1))
    elif options.keys:
        print(keys_page(), end="")
    elif options.name is None:
        print("\n".join(names()))
    else:
        try:
            print(text_of(options.name), end="")
        except ScenarioError as error:
            return refuse("scenario", error)
    return 0
