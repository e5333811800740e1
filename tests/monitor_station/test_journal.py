"""The monitor station's journal: a new process knows all reports that earlier ones acknowledged."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from deploy.scenario import load
from deploy.simulation import Simulation
from monitor_station.core import Station
from monitor_station.process import next_part
from tests import ROOT

TICKS = 150


@pytest.fixture(scope="module")
def mission() -> tuple[Station, bytes, Station]:
    """A station after a while, its journal, and a newcomer that knows nothing."""
    scenario = load(ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml")
    simulation = Simulation(scenario)
    journal = b""
    for _ in range(TICKS):
        simulation.step()
        assert simulation.station is not None
        journal += simulation.station.journal()
    assert simulation.station is not None
    return simulation.station, journal, Station(scenario.station_config(), random.Random(1), 1, TICKS)


def test_a_new_process_has_everything_that_was_acknowledged(mission: tuple[Station, bytes, Station]) -> None:
    before, journal, after = mission
    assert len(journal) > 1000
    assert after.restore(journal) == len(journal)
    assert after.merger.merged == before.merger.merged > 0
    assert after.merger.acks() == before.merger.acks()
    assert after.merger.cells.tobytes() == before.merger.cells.tobytes()
    assert after.search.rates == before.search.rates
    assert after.search.search_time_s == before.search.search_time_s
    assert after.downlink.version == before.downlink.version, "robots go on from the version that they hold"
    assert after.final()["merged_ticks"] == before.final()["merged_ticks"]
    assert after.journal() == b"", "nothing is written twice"


def test_a_record_that_was_cut_off_is_left_out() -> None:
    scenario = load(ROOT / "tests" / "helpers" / "scenarios" / "corridor.toml")
    simulation = Simulation(scenario)
    records: list[bytes] = []
    while len(records) < 3:
        simulation.step()
        assert simulation.station is not None
        records += [record for record in [simulation.station.journal()] if record]
    whole = b"".join(records[:2])
    for cut in (1, 7, 8, 9, len(records[2]) - 1):
        station = Station(scenario.station_config(), random.Random(1), 1, TICKS)
        kept = station.restore(whole + records[2][:cut])
        assert len(whole) <= kept < len(whole) + len(records[2])
        assert (
            Station(scenario.station_config(), random.Random(1), 1, TICKS).restore((whole + records[2])[:kept]) == kept
        )


def test_each_process_of_a_station_records_a_part_of_its_own(tmp_path: Path) -> None:
    for name in ("recording.rrd", "recording-2.rrd", "recording-3.rrd"):
        part = next_part(tmp_path)
        assert part == tmp_path / name
        part.touch()
