"""One robot by hand: `python -m agents --id 4 --connect tcp/HOST:7447 --credentials FILE`."""

from __future__ import annotations

import dataclasses

from setproctitle import setproctitle

from agents.config import RobotConfig
from agents.policies import PolicyError, policy_class
from agents.process import run
from bus.command_line import parse, parser
from bus.excerpt import shown
from bus.nodes import node_name, process_name, user_name


def main(arguments: list[str] | None = None) -> None:
    """Run one robot until the run ends."""
    made = parser("agents", __doc__ or "")
    made.add_argument("--id", type=int, help="the robot that this is, if the file is not for one already")
    options, handover = parse(made, arguments, config=RobotConfig)
    config: RobotConfig = handover.entries["config"]
    if options.id is not None:
        config = dataclasses.replace(config, node=options.id)
    if handover.login.user != user_name(config.node):
        login = shown(handover.login.user)
        made.exit(2, f"{made.prog}: the file's login is {login}'s, not {node_name(config.node)}'s\n")
    try:
        policy_class(config.policy)
    except PolicyError as error:
        policy = f"policy = '{shown(config.policy)}': {shown(error, 150)}"
        made.exit(2, f"{made.prog}: {shown(options.credentials)}: {policy}\n")
    setproctitle(f"vds {process_name(config.node)} {handover.login.run}")
    run(config, handover.login)


if __name__ == "__main__":
    main()
