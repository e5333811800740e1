"""A robot as a process: sense and inbox in, frames and motion out."""

from __future__ import annotations

import functools
import logging

from agents.config import RobotConfig
from agents.policies import PolicyError, policy_class
from agents.robot import Robot
from bus.excerpt import shown
from bus.member import Member, exit_status
from bus.session import Login
from medium.messages import Inbox, Transmission
from world.messages import Sense
from world.seeds import node_stream

__all__ = ["run"]


def run(config: RobotConfig, login: Login) -> None:
    """Run one robot until the run ends.

    A new process is a new incarnation with an empty memory. A process that was paused goes on with what it knew.

    Raises:
        SystemExit: world, medium or router were lost or never there (status 3), or another living process is this
            robot already (status 4).
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    with exit_status():
        _run(config, login)


def _run(config: RobotConfig, login: Login) -> None:
    try:
        policy = policy_class(config.policy)
    except PolicyError as error:  # here, though not where the scenario was checked
        raise SystemExit(f"policy = '{shown(config.policy)}': {error}") from error
    sense_of = functools.partial(Sense.decode, lidar_beams=config.lidar_beams)
    inbox_of = functools.partial(Inbox.decode, robots=config.robots)
    member = Member(login, "robot", config.node, sense_of, inbox_of)
    with member:
        put_table = member.session.publisher(member.session.keys.table(config.node), blocking=False)
        robot: Robot | None = None
        while (turn := member.turn()) is not None:
            sense, inbox = turn
            if robot is None:
                rng = node_stream(config.seed, config.node, sense.incarnation)
                robot = Robot(config, policy, rng, sense.incarnation, sense.tick)
                robot.mark = member.phases.mark
            frames, motion = robot.step(sense, inbox)
            member.answer(sense.tick, Transmission(sense.tick, config.node, frames).encode(), motion.encode())
            table = robot.table()
            if table is not None:
                put_table(table.encode())
            member.phases.mark("recording")
