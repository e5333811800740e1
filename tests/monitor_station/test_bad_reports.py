"""Scan reports that no honest robot made: the station goes on, and the counts of the run show them."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

from agents.messages import ScanReport
from deploy.run_folder.verdicts import foreign_reports, lost_reports
from deploy.scenario import load
from medium.messages import Inbox, Reception
from monitor_station.core import Station
from world.messages import Sense
from world.terms import STATION

N = 9
"""Robots of three_cells."""


def reported(origin: int, number: int, cells: Any, incarnation: int = 0, victims: Any = ()) -> Reception:
    cells = np.array(cells, np.uint32)
    report = ScanReport(origin, incarnation, number, cells, np.zeros(len(cells), np.int8), tuple(victims))
    return 2, -60.0, report.encode()


def station_after(*heard: Reception, tick: int = 20) -> Station:
    station = Station(load("three_cells").station_config(), random.Random(1), 0, 0)
    for now in range(tick + 1):
        station.step(Sense(now, now == 0, 0, 28.0, 35.0), Inbox(now, heard if now == tick else ()) if now else None)
    return station


@pytest.mark.parametrize(
    "reception",
    [
        pytest.param(reported(STATION, 1, [1]), id="of the MS"),
        pytest.param(reported(N + 1, 1, [1]), id="of a robot that there is not"),
        pytest.param(reported(4, 21, [1]), id="later than any can be"),
        pytest.param(reported(4, 2**31 - 1, [1]), id="far later"),
        pytest.param(reported(4, 2, [1], incarnation=19), id="of an incarnation that can't have made it"),
        pytest.param(reported(4, 1, [1], incarnation=30_000), id="of an incarnation that can't be"),
        pytest.param(reported(4, 1, [1, 2, 1]), id="a cell twice"),
        pytest.param(reported(4, 1, [10**6]), id="a cell outside"),
        pytest.param(reported(4, 1, [1], victims=[(3, 1e5, 5.0)]), id="a victim outside"),
    ],
)
def test_a_scan_report_that_cannot_be_is_malformed(reception: Reception) -> None:
    good = reported(4, 20, [1]), reported(5, 1, [2], incarnation=19, victims=[(3, 5.0, 5.0)])
    final = station_after(reception, *good).final()
    assert (final["bad_frames"], final["merged"]) == (1, 2)


def test_who_speaks_in_the_name_of_another_shows_in_the_counts() -> None:
    """Robot 2 sends robot 4's next reports, before robot 4 has made them, and one that it never makes."""
    forged = [reported(4, number, [number]) for number in (2, 3, 9)]
    real = [reported(4, number, [100 + number]) for number in (1, 2, 3, 4)]
    station = station_after(*forged, *real, *real, forged[0])
    final = station.final()
    assert (final["merged"], final["complete"], final["ahead"]) == (5, {"4/0": 4}, {"4/0": [9]})
    world = {"made": {"4/0": 4}, "acknowledged": {"4": [0, 4]}}
    assert lost_reports(world["acknowledged"], final) == 2, "2 and 3 are not on the map"
    assert foreign_reports(world["made"], final) == 1, "9 is, but nobody made it"
    # A station that comes back counts the same.
    back = Station(load("three_cells").station_config(), random.Random(1), 1, 21)
    journal = station.journal()
    assert back.restore(journal) == len(journal)
    assert back.final() == final


def test_a_spoiled_journal_costs_what_is_spoiled_and_no_more() -> None:
    journal = bytearray(station_after(reported(4, 1, [1]), reported(4, 2, [2])).journal())
    journal[12] ^= 0xFF
    back = Station(load("three_cells").station_config(), random.Random(1), 1, 21)
    assert back.restore(bytes(journal)) == len(journal)
    assert (back.final()["merged"], back.final()["bad_frames"]) == (1, 1)
