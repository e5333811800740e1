"""The world by hand: `python -m world --connect tcp/HOST:7447 --credentials FILE`."""

from __future__ import annotations

from setproctitle import setproctitle

from bus.command_line import parse, parser
from world.config import WorldConfig
from world.process import run


def main(arguments: list[str] | None = None) -> None:
    """Run the world until the run ends."""
    _, handover = parse(parser("world", __doc__ or ""), arguments, config=WorldConfig)
    setproctitle(f"vds world {handover.login.run}")
    run(handover.entries["config"], handover.login)


if __name__ == "__main__":
    main()
