"""A monitor station that did not live to the end of its run, as its journal has it: everything it acknowledged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bus.codec import WireError
from monitor_station.core import Station
from world.seeds import node_stream
from world.terms import STATION

if TYPE_CHECKING:
    from deploy.scenario import Scenario

__all__ = ["read_journal"]


def read_journal(path: Path, scenario: Scenario) -> Station | None:
    """The station as it was when it wrote the last entry; None if there is no journal, or it is damaged."""
    try:
        journal = path.read_bytes()
        station = Station(scenario.station_config(), node_stream(scenario.seed, STATION, 0), 0, 0)
        station.restore(journal)
    except (OSError, WireError):
        return None
    return station
