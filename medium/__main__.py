"""The medium by hand: `python -m medium --credentials FILE`; hosts the router if the file lists the run's users."""

from __future__ import annotations

from setproctitle import setproctitle

from bus.command_line import parse, parser
from medium.config import MediumConfig
from medium.process import run


def main(arguments: list[str] | None = None) -> None:
    """Run the medium until the run ends."""
    _, handover = parse(parser("medium", __doc__ or ""), arguments, config=MediumConfig, users=dict[str, str] | None)
    setproctitle(f"vds medium {handover.login.run}")
    run(handover.entries["config"], handover.login, handover.entries["users"])


if __name__ == "__main__":
    main()
