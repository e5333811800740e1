"""The options by which a command line names and changes a scenario, the same for all commands that run one."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deploy.command import Parser

__all__ = ["add_scenario_options", "overrides_of"]


def add_scenario_options(p: Parser) -> None:
    """Add --robots, --radius, --seed, --duration, --policy, --set and --fault."""
    from deploy.command import a_number, a_whole_number

    p.add_argument("--robots", type=a_whole_number, metavar="N", help="how many robots (default: the scenario's)")
    p.add_argument("--radius", type=a_number, metavar="M", help="transmission radius r_t in metres")
    p.add_argument("--seed", type=a_whole_number, metavar="N", help="of everything random")
    p.add_argument("--duration", type=a_number, metavar="S", help="simulated seconds after which the run ends")
    p.add_argument("--policy", metavar="NAME", help="rules of the robots: vds, scout, sortie, or module:Class")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any other key of a scenario")
    p.add_argument("--fault", action="append", default=[], metavar="VERB:TARGET@T[+D]", help="e.g. kill:relay:mid@90")


def overrides_of(options: argparse.Namespace) -> dict[str, Any]:
    """What the options say, as `deploy.scenario.load` takes it.

    Raises:
        ScenarioError: one of --set is wrong.
    """
    from deploy.scenario import parse_set

    given = {
        "robots": options.robots,
        "radius_m": options.radius,
        "seed": options.seed,
        "duration_s": options.duration,
        "policy": options.policy,
        "fault": options.fault or None,
    }
    overrides = dict(parse_set(text) for text in options.set)
    return overrides | {key: value for key, value in given.items() if value is not None}
