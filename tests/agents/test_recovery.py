"""The verdict on faults, over trees of NMS pointers made by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from world.config import Fault
from world.feed import Snapshot
from world.recovery import Recoveries
from world.routes import chain_from, chain_to_station
from world.terms import NOBODY, STATION, UNREACHABLE, Mode

CHAIN = {1: 0, 2: 1, 3: 2, 4: 3, 5: 0}
STATION_M = (0.0, 0.0)
UNTOUCHED = {"departed": False, "incarnation": 0, "reports_before": 0, "reports_made": 0, "reports_discarded": 0}
"""Entry of an orphan that lived on and made no scan report."""


def shown(tick: int, nms: Mapping[int, int], absent: tuple[int, ...] = ()) -> Snapshot:
    """Robots in a row along x, with hops 255 where the pointer is NOBODY."""
    n = len(nms)
    nodes = np.arange(1, n + 1, dtype=np.int16)
    pointers = np.array([nms[k] for k in range(1, n + 1)], np.int16)
    return Snapshot(
        tick,
        nodes,
        np.array([k not in absent for k in range(1, n + 1)], np.uint8),
        np.column_stack((nodes.astype(float), np.zeros(n))),
        np.zeros(n, np.uint8),
        np.zeros(n, np.uint8),
        np.where(pointers == NOBODY, UNREACHABLE, 1).astype(np.uint8),
        pointers,
        np.full(n, NOBODY, np.int16),
        np.zeros((n, 2)),
    )


class Watch:
    """Feeds snapshots of consecutive ticks."""

    def __init__(self, tick: int = 9) -> None:
        self.recoveries = Recoveries(STATION_M)
        self.last = shown(tick, CHAIN)

    def fault(self, fault: Fault, node: int = NOBODY) -> None:
        self.recoveries.begin(fault, node, self.last.tick + 1, self.last)

    def ticks(
        self, count: int, changes: Mapping[int, int] | None = None, absent: tuple[int, ...] = (), station: bool = True
    ) -> None:
        for _ in range(count):
            now = shown(self.last.tick + 1, {**CHAIN, **(changes or {})}, absent)
            self.recoveries.update(self.last, now, station_speaks=station)
            self.last = now

    def verdict(self) -> dict[str, object]:
        return self.recoveries.verdicts()[0]


def test_a_chain_ends_at_dead_ends_and_loops() -> None:
    assert chain_from(4, shown(9, CHAIN)) == [4, 3, 2, 1, STATION]
    assert chain_from(4, shown(9, CHAIN, absent=(2,))) == [4, 3]
    assert chain_from(4, shown(9, {**CHAIN, 3: NOBODY})) == [4, 3]
    assert chain_from(4, shown(9, {**CHAIN, 2: 4})) == [4, 3, 2]
    for broken in (shown(9, CHAIN, absent=(2,)), shown(9, {**CHAIN, 3: NOBODY}), shown(9, {**CHAIN, 2: 4})):
        assert chain_to_station(4, broken) == []


def test_orphans_of_a_relay_notice_and_recover() -> None:
    watch = Watch()
    watch.fault(Fault("kill", 1.0, "2"), 2)
    watch.ticks(5, absent=(2,))
    watch.ticks(3, {3: NOBODY, 4: NOBODY}, absent=(2,))
    watch.ticks(4, {3: 1, 4: NOBODY}, absent=(2,))
    watch.ticks(9, {3: 1, 4: 3}, absent=(2,))
    assert watch.verdict() == {
        "robot": 2,
        "at_s": 1.0,
        "kind": "kill",
        "target": "2",
        "fault": "kill:2@1",
        "orphaned": [3, 4],
        "detected_s": 0.5,
        "recovered_s": 1.2,
        "recovered": True,
        "robot_seconds_without_path": pytest.approx(0.8 + 1.2),
        "orphans": [
            {"robot": 3, "detected_s": 0.5, "recovered_s": 0.8, **UNTOUCHED},
            {"robot": 4, "detected_s": 0.5, "recovered_s": 1.2, **UNTOUCHED},
        ],
    }


def test_a_route_over_a_dead_robot_is_no_route() -> None:
    watch = Watch()
    watch.fault(Fault("kill", 1.0, "2"), 2)
    watch.ticks(20, absent=(2,))
    assert watch.verdict()["recovered"] is False
    assert watch.verdict()["detected_s"] is None
    assert watch.verdict()["recovered_s"] is None
    assert watch.verdict()["robot_seconds_without_path"] == pytest.approx(4.0)


def test_nobody_depended_on_it() -> None:
    watch = Watch()
    watch.fault(Fault("kill", 1.0, "4"), 4)
    watch.ticks(3, absent=(4,))
    assert watch.verdict()["recovered"] == "not affected"
    assert watch.verdict()["orphaned"] == []


def test_who_had_no_route_before_is_no_orphan() -> None:
    watch = Watch()
    watch.ticks(1, {4: NOBODY})
    watch.fault(Fault("kill", 1.1, "2"), 2)
    assert watch.verdict()["orphaned"] == [3]


def test_a_short_pause_that_nobody_noticed() -> None:
    watch = Watch()
    watch.fault(Fault("pause", 1.0, "2", 0.4), 2)
    watch.ticks(4, absent=(2,))
    watch.ticks(2)
    verdict = watch.verdict()
    assert (verdict["recovered"], verdict["detected_s"], verdict["recovered_s"]) == (True, None, 0.4)


def test_an_orphan_that_dies_itself_is_not_waited_for() -> None:
    watch = Watch()
    watch.fault(Fault("kill", 1.0, "2"), 2)
    watch.ticks(3, absent=(2,))
    watch.ticks(3, {4: 5}, absent=(2, 3))
    assert watch.verdict()["recovered"] is True
    assert watch.verdict()["recovered_s"] == 0.3
    alone = Watch()
    alone.fault(Fault("kill", 1.0, "3"), 3)
    alone.ticks(3, absent=(3, 4))
    assert alone.verdict()["recovered"] is False, "nobody was left to recover"


def test_the_station_orphans_everybody_until_it_is_back() -> None:
    watch = Watch()
    watch.fault(Fault("restart", 1.0, "station", 0.5), 0)
    watch.ticks(5, station=False)
    watch.ticks(1)
    assert watch.verdict()["orphaned"] == [1, 2, 3, 4, 5]
    assert watch.verdict()["recovered_s"] == 0.5


def test_jams_cut_links_while_they_last() -> None:
    pair = Watch()
    pair.fault(Fault("jam", 1.0, "2,3", 1.0))
    pair.ticks(5)
    pair.ticks(1, {4: 5})
    pair.ticks(9)
    assert pair.verdict()["robot"] is None
    assert pair.verdict()["orphaned"] == [3, 4]
    assert [o["recovered_s"] for o in pair.recoveries.verdicts()[0]["orphans"]] == [1.0, 0.5]
    region = Watch()
    region.fault(Fault("jam", 1.0, "2.5,-1,3.5,1", 1.0))
    assert region.verdict()["orphaned"] == [3, 4]
    station = Watch()
    station.fault(Fault("jam", 1.0, "-1,-1,0.5,1", 1.0))
    assert station.verdict()["orphaned"] == [1, 2, 3, 4, 5], "the MS hears nobody"
    away = Watch()
    away.fault(Fault("jam", 1.0, "1,3", 1.0))
    assert away.verdict()["recovered"] == "not affected"


def test_loss_has_those_who_lose_their_route_while_it_lasts() -> None:
    watch = Watch()
    watch.fault(Fault("loss", 1.0, "", 1.0, 0.9))
    watch.ticks(3)
    watch.ticks(2, {4: NOBODY})
    watch.ticks(7)
    watch.ticks(2, {5: NOBODY})
    verdict = watch.recoveries.verdicts()[0]
    assert verdict["orphans"] == [{"robot": 4, "detected_s": 0.3, "recovered_s": 0.5, **UNTOUCHED}]


@pytest.mark.parametrize(("mode", "orphans"), [(Mode.AWAY, []), (Mode.LOST, [4])])
def test_loss_is_not_blamed_for_a_sortie(mode: Mode, orphans: list[int]) -> None:
    watch = Watch()
    watch.fault(Fault("loss", 1.0, "", 1.0, 0.9))
    gone = shown(watch.last.tick + 1, {**CHAIN, 4: NOBODY})
    gone.mode[3] = mode
    watch.recoveries.update(watch.last, gone, station_speaks=True)
    assert watch.verdict()["orphaned"] == orphans


def test_an_unscheduled_kill_that_turns_out_a_restart() -> None:
    watch = Watch()
    was = Fault("kill", 1.0, "2")
    watch.fault(was, 2)
    watch.recoveries.replace(was, Fault("restart", 1.0, "2", 3.0))
    assert watch.verdict()["kind"] == "restart"
