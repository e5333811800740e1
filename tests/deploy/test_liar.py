"""Whole missions with a robot that lies: what no honest robot says changes nothing, and what it can say shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from agents.forwarding_table import ROW, freshness_of
from agents.messages import MapChunk, ScanReport, Update
from agents.robot import Robot
from deploy.run_folder.verdicts import foreign_reports, lost_reports
from deploy.scenario import load
from deploy.simulation import Result, Simulation
from medium.messages import BROADCAST, Frame, Inbox
from world.messages import Motion, Sense
from world.terms import NOBODY, STATION

LIAR = 3
NEIGHBOR = 2
UNTIL_TICK = 300
Lie = Callable[[Robot, int], list[Frame]]


class Lying(Simulation):
    """Robot LIAR adds frames to its own until UNTIL_TICK."""

    def __init__(self, lie: Lie) -> None:
        super().__init__(load("three_cells", {"robots": 5, "radius_m": 12.0, "duration_s": 60.0, "seed": 4}))
        self.lie = lie

    def _robot_for(self, node: int, sense: Sense) -> Robot:
        robot = super()._robot_for(node, sense)
        if node == LIAR and sense.tick < UNTIL_TICK:
            return LyingRobot(robot, self.lie)  # type: ignore[return-value]
        return robot


class LyingRobot:
    def __init__(self, honest: Robot, lie: Lie) -> None:
        self._honest, self._lie = honest, lie

    def step(self, sense: Sense, inbox: Inbox | None) -> tuple[tuple[Frame, ...], Motion]:
        frames, motion = self._honest.step(sense, inbox)
        return frames + tuple(self._lie(self._honest, sense.tick)), motion


def said(tick: int, *entries: tuple[int, int, int]) -> list[Frame]:
    rows = [ROW.pack(dst, freshness_of(seqno, hop), bytes(18)) for dst, seqno, hop in ((LIAR, 2 * tick, 0), *entries)]
    return [(BROADCAST, Update(NOBODY, NOBODY, 0, b"".join(rows), b"").encode())]


def strangers(_: Robot, tick: int) -> list[Frame]:
    return said(tick, *((dst, 2 * tick, 1) for dst in range(6, 2000)))


def numbers_of_the_future(_: Robot, tick: int) -> list[Frame]:
    return said(tick, (STATION, 2**54, 1), (NEIGHBOR, 2**54, 1))


def chunk(first: int, cells: object, value: int) -> list[Frame]:
    cells = np.array(cells, np.uint32)
    payload = MapChunk(first, cells, np.full(len(cells), value, np.int8)).encode()
    return [(node, payload) for node in (1, NEIGHBOR, 4, 5)]


def changes_of_the_future(_: Robot, __: int) -> list[Frame]:
    return chunk(2_000_306, [1], 1) + chunk(0, np.zeros(2000), 0)


def next_reports(robot: Robot, tick: int) -> list[Frame]:
    """As many reports of its neighbor's as there can be by now."""
    report = ScanReport(NEIGHBOR, 0, tick, np.array([tick], np.uint32), np.zeros(1, np.int8))
    return [(robot.body.router.ms.nms, report.encode())] if tick > 0 and robot.body.router.ms.nms != NOBODY else []


@pytest.fixture(scope="module")
def honest() -> Result:
    return Lying(lambda _robot, _tick: []).run()


@pytest.mark.parametrize("lie", [strangers, numbers_of_the_future, changes_of_the_future])
def test_what_no_honest_robot_says_changes_nothing(lie: Lie, honest: Result) -> None:
    """Everybody moves and finds as if it had not been said; only the frames differ."""
    mission = Lying(lie)
    result = mission.run()
    for name in ("xy_m", "nms", "hops", "search_rate"):
        np.testing.assert_array_equal(getattr(result.traces, name), getattr(honest.traces, name))
    assert result.finals["station"]["merged"] == honest.finals["station"]["merged"]
    bad = {node: robot.bad_frames + robot.body.router.bad_frames for node, robot in mission.robots.items()}
    assert sum(bad.values()) >= UNTIL_TICK / 2
    assert all(max(robot.body.router.table.known) <= 5 for robot in mission.robots.values())


def test_a_map_of_nothing_but_walls_stops_nobody_for_good() -> None:
    """It is what the MS could have made, so it is believed; but nobody falls over it."""
    mission = Lying(lambda robot, _: chunk(0, np.flatnonzero(robot.body.map.cells >= 0)[:2000], 1))
    result = mission.run()
    assert result.finals["world"]["ticks"] == 600


def test_reports_in_the_name_of_another_show_in_the_counts(honest: Result) -> None:
    for finals, forged in ((honest.finals, False), (Lying(next_reports).run().finals, True)):
        world, station = finals["world"], finals["station"]
        lost, foreign = lost_reports(world["acknowledged"], station), foreign_reports(world["made"], station)
        assert (lost > 0, foreign > 0) == (forged, forged), (lost, foreign)
