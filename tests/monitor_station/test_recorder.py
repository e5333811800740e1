"""The recording, read back from its file, and the pure functions behind it."""

from __future__ import annotations

import socket
import subprocess
import sys
import warnings
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from agents.messages import Table
from monitor_station.recording.chain import farthest_chain, tree_layout
from monitor_station.recording.recorder import Recorder
from monitor_station.recording.states import State, SteadyStates
from monitor_station.recording.table_text import table_markdown
from monitor_station.recording.tiles import MapTiles
from tests import ROOT
from tests.helpers.recordings import readable, rrd
from tests.helpers.synthetic import Mission, Moment, feed, record
from tests.helpers.waiting import wait_until
from world.feed import Event, Snapshot
from world.grid import FREE, GridGeometry
from world.terms import NOBODY, STATION, Cls, Mode

TICKS = 1_000
KILL_TICK = 600
DROPPED = range(700, 730)


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@dataclass
class Recording:
    """What was fed, and every row of the file: entity and column -> (tick, value), in order of ticks."""

    path: Path
    recorder: Recorder
    moments: list[Moment]
    mission: Mission
    rows: dict[tuple[str, str], list[tuple[int, Any]]] = field(default_factory=dict)

    def at(self, entity: str, column: str, tick: int) -> Any:
        """The value in force at a tick."""
        rows = self.rows[entity, column]
        following = bisect_right(rows, tick, key=lambda row: row[0])
        assert following, f"nothing in {entity} {column} up to {tick}"
        return rows[following - 1][1]


def read(path: Path) -> dict[tuple[str, str], list[tuple[int, Any]]]:
    rows: dict[tuple[str, str], list[tuple[int, Any]]] = defaultdict(list)
    for chunk in rr.chunk.RrdReader(path).stream():
        batch = chunk.to_record_batch().to_pydict()
        ticks = batch.get("tick")
        for name, values in batch.items():
            if name in ("tick", "sim_time") or name.endswith("RowId"):
                continue
            for row, value in enumerate(values):
                if value is not None:
                    rows[chunk.entity_path, name].append((ticks[row] if ticks else -1, value))
    for entries in rows.values():
        entries.sort(key=lambda entry: entry[0])
    return rows


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    mission = Mission(9, kill_tick=KILL_TICK)
    recorder, moments = record(mission, path, TICKS, DROPPED)
    return Recording(path, recorder, moments, mission, read(path))


def test_final_map_equals_the_fed_map(recording: Recording) -> None:
    tiles = MapTiles(recording.mission.config.geometry).tiles
    image = np.full((140, 108), 77, np.uint8)
    for tile in tiles:
        pixels = recording.at(f"/ms/map/{tile.name}", "GridMap:data", TICKS)[0]
        part = np.array(pixels, np.uint8).reshape(tile.rows, tile.cols)[::-1]
        image[tile.row : tile.row + tile.rows, tile.col : tile.col + tile.cols] = part
    fed = recording.mission.map.reshape(140, 108)
    expected = np.select([fed == 0, fed == 1], [0, 100], 255)
    assert (fed == FREE).sum() > 500
    assert np.array_equal(image, expected)


def test_chain_equals_the_pointers_at_every_tick(recording: Recording) -> None:
    config = recording.mission.config
    longest = 0
    for moment in recording.moments:
        snapshot = moment.snapshot
        if snapshot.tick in DROPPED:
            continue
        nodes = recording.at("/network/chain", "nodes", snapshot.tick)
        pointers = recording.at("/network/links", "nms", snapshot.tick)
        assert pointers == snapshot.nms.tolist()
        assert tuple(nodes) == farthest_chain(snapshot, config.station_m)
        assert all(pointers[a - 1] == b for a, b in pairwise(nodes))
        longest = max(longest, len(nodes))
    assert longest >= 3


def test_chain_is_drawn_through_its_nodes(recording: Recording) -> None:
    drawn = 0
    for tick in range(0, DROPPED.start, 5):
        snapshot = recording.moments[tick].snapshot
        nodes = recording.at("/network/chain", "nodes", tick)
        strips = recording.at("/network/chain", "LineStrips3D:strips", tick)
        assert len(strips) == (1 if nodes else 0)
        for strip in strips:
            places = [(28.0, 35.0) if node == STATION else snapshot.xy_m[node - 1] for node in nodes]
            assert np.allclose(np.array(strip)[:, :2], places, atol=1e-4)
            drawn += 1
    assert drawn > 50


def test_positions_are_there_ten_times_a_second(recording: Recording) -> None:
    rows = recording.rows["/ms/robots", "Points3D:positions"]
    assert [tick for tick, _ in rows] == list(range(TICKS))
    for tick in (0, 333, 999):
        assert np.allclose(np.array(rows[tick][1])[:, :2], recording.moments[tick].view.xy_m, atol=1e-5)


def test_killed_robot_is_shown_dead_and_out_of_contact(recording: Recording) -> None:
    states = recording.rows["/network/state/4", "StateChange:state"]
    assert (KILL_TICK, ["dead"]) in states
    assert states[-1] == (KILL_TICK, ["dead"])
    before = recording.at("/ms/robots", "Points3D:colors", KILL_TICK - 1)[3]
    after = recording.at("/ms/robots", "Points3D:colors", KILL_TICK)[3]
    assert after == 0xCC79A7FF
    assert (
        recording.at("/truth/robots", "Points3D:colors", KILL_TICK)[3]
        != recording.at("/truth/robots", "Points3D:colors", KILL_TICK - 1)[3]
    )
    assert before in (after, 0xE69F00FF, 0x56B4E9FF)
    assert recording.at("/truth/gone", "Points3D:labels", TICKS) == ["4 dead"]


def test_gap_in_the_feed_is_counted_and_marked(recording: Recording) -> None:
    assert recording.recorder.dropped_ticks == len(DROPPED)
    lines = recording.rows["/events/fault", "TextLog:text"]
    assert (DROPPED.start, ["30 ticks of the world's feed were dropped (30 so far)"]) in lines


def test_plots_tables_and_truth_are_there(recording: Recording) -> None:
    rates = recording.at("/plots/search", "Scalars:scalars", TICKS)
    assert np.allclose(rates, recording.moments[990].view.search_rate)
    connected, most, mean = recording.at("/plots/network", "Scalars:scalars", 500)
    hops = recording.moments[500].snapshot.hops
    finite = hops[hops < 255]
    assert (connected, most) == (len(finite), finite.max() if len(finite) else 0)
    assert mean <= most
    assert "| dst | nxt | hop |" in recording.at("/network/table/9", "TextDocument:text", TICKS)[0]
    assert len(recording.rows["/truth/victims", "Points3D:positions"][0][1]) == 4


def test_file_is_verified(recording: Recording) -> None:
    done = rrd("verify", recording.path)
    assert done.returncode == 0, done.stderr


def test_close_is_idempotent_and_old_snapshots_are_ignored(tmp_path: Path) -> None:
    mission = Mission(3, kill_tick=1_000)
    recorder, moments = record(mission, tmp_path / "run.rrd", 20)
    recorder.close()
    rows = read(tmp_path / "run.rrd")
    count = len(rows["/network/links", "nms"])
    again = Recorder(mission.config, tmp_path / "twice.rrd")
    feed(again, moments)
    for moment in moments:
        again.snapshot(moment.snapshot)
    again.close()
    assert len(read(tmp_path / "twice.rrd")["/network/links", "nms"]) == count
    assert again.dropped_ticks == 0


def test_paused_robot_is_not_called_dead(tmp_path: Path) -> None:
    mission = Mission(3, killed=2, kill_tick=10)
    recorder = Recorder(mission.config, tmp_path / "run.rrd")
    for moment in mission.moments(20):
        if moment.snapshot.tick == 10:
            recorder.event(Event(10, "fault", 2, "robot 2 was paused", {"verb": "pause"}))
        recorder.snapshot(moment.snapshot)
    recorder.close()
    assert read(tmp_path / "run.rrd")["/network/state/2", "StateChange:state"][-1] == (10, ["paused"])


def test_unwritable_path_raises(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="missing"):
        Recorder(Mission(2).config, tmp_path / "missing" / "run.rrd")


def _listens(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.processes
def test_live_view_listens_on_loopback(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    recorder = Recorder(Mission(2).config, tmp_path / "run.rrd", live_port=port)
    wait_until(lambda: _listens(port), "somebody listens")
    recorder.close()


@pytest.mark.processes
def test_recording_of_a_killed_process_is_readable_and_repaired(tmp_path: Path) -> None:
    path = tmp_path / "bad.rrd"
    script = (
        "import sys; from pathlib import Path; from tests.helpers.synthetic import Mission, feed\n"
        "from monitor_station.recording.recorder import Recorder\n"
        "mission = Mission(9); recorder = Recorder(mission.config, Path(sys.argv[1]))\n"
        "feed(recorder, list(mission.moments(1101))); print('fed', flush=True); sys.stdin.read()\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", script, str(path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
    )  # fmt: skip
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "fed\n"
        wait_until(lambda: _last_tick(path) >= 590, "the file grows")
        child.kill()
    assert _last_tick(path) >= 590
    assert rrd("verify", path).returncode != 0
    assert rrd("optimize", path, "-o", tmp_path / "good.rrd").returncode == 0
    assert rrd("verify", tmp_path / "good.rrd").returncode == 0
    assert _last_tick(tmp_path / "good.rrd") >= 590


def _last_tick(path: Path) -> int:
    """Last tick with positions; a file without a footer makes the reader warn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return max((tick for tick, _ in read(readable(path))["/ms/robots", "Points3D:positions"]), default=-1)


@pytest.mark.parametrize(("robots", "megabytes"), [(9, 60), (100, 150)])
def test_size_stays_within_bounds(tmp_path: Path, robots: int, megabytes: float) -> None:
    """Megabytes per simulated hour. CPU time is the benchmark's business: a shared machine makes it a poor test."""
    moments = list(Mission(robots, kill_tick=500).moments(900))
    sizes = []
    for ticks in (200, 900):  # the difference leaves out what is written once
        recorder = Recorder(Mission(robots).config, tmp_path / "run.rrd")
        feed(recorder, moments[:ticks])
        recorder.close()
        sizes.append((tmp_path / "run.rrd").stat().st_size)
    grown = (sizes[1] - sizes[0]) / 1e6 * 36_000 / 700
    assert 1 < grown <= megabytes


def _snapshot(nms: list[int], hops: list[int], cls: list[int], x_m: list[float]) -> Snapshot:
    count = len(nms)
    return Snapshot(
        0, np.arange(1, count + 1, dtype=np.int16), np.ones(count, np.uint8),
        np.column_stack((x_m, np.zeros(count))), np.array(cls, np.uint8), np.full(count, Mode.WALK, np.uint8),
        np.array(hops, np.uint8), np.array(nms, np.int16), np.full(count, NOBODY, np.int16), np.zeros((count, 2)),
    )  # fmt: skip


def test_chain_starts_at_most_hops_then_at_the_farthest() -> None:
    sr, rr_ = Cls.SR, Cls.RR
    far = _snapshot([0, 1, 1, 0], [1, 2, 2, 1], [rr_, sr, sr, sr], [5.0, 8.0, 9.0, 99.0])
    assert farthest_chain(far, (0.0, 0.0)) == (3, 1, STATION)
    none = _snapshot([NOBODY, NOBODY], [255, 255], [sr, sr], [1.0, 2.0])
    assert farthest_chain(none, (0.0, 0.0)) == ()


def test_short_corrections_do_not_show_but_death_does_at_once() -> None:
    steady = SteadyStates(1)
    relay, recovering = np.array([State.RELAY]), np.array([State.RECOVERING])
    shown = [int(steady.update(tick, recovering if tick % 3 else relay)[0]) for tick in range(30)]
    assert set(shown) == {State.RELAY}
    later = [int(steady.update(tick, recovering)[0]) for tick in range(30, 45)]
    assert later[-1] == State.RECOVERING
    assert steady.update(45, np.array([State.DEAD]))[0] == State.DEAD
    assert steady.update(46, relay)[0] == State.RELAY
    assert steady.update(47, np.array([State.AWAY]))[0] == State.AWAY
    assert steady.update(48, relay)[0] == State.RELAY


def test_tree_layout_gives_every_node_a_place_of_its_own() -> None:
    nodes = list(range(8))
    places = tree_layout(nodes, {1: 0, 2: 0, 3: 1, 4: 1, 5: 6, 6: 5})
    assert len({tuple(place) for place in places.tolist()}) == len(nodes)
    assert (places >= 0).all()
    assert (places <= 1).all()
    assert places[3, 1] > places[1, 1] > places[0, 1]
    assert (places[[5, 6, 7], 1] > places[3, 1]).all()


def test_tiles_take_only_what_changed_and_flip_rows() -> None:
    tiles = MapTiles(GridGeometry(70, 130))
    assert [tile.name for tile in tiles.tiles] == [
        "t000_000",
        "t000_001",
        "t000_002",
        "t001_000",
        "t001_001",
        "t001_002",
    ]
    tiles.apply(np.array([0, 65 * 130 + 129]), np.array([0, 1], np.int8))
    (low, low_bytes), (high, high_bytes) = tiles.take()
    assert (low.name, high.name) == ("t000_000", "t001_002")
    assert low_bytes[63 * 64] == 0
    assert low_bytes.count(255) == 64 * 64 - 1
    assert (high.rows, high.cols) == (6, 2)
    assert high_bytes[(6 - 1 - 1) * 2 + 1] == 100
    assert tiles.take() == []


def test_table_is_printed_as_in_figure_2() -> None:
    """Rows MS, D, E and a lost robot of the table of robot C, whose id is 3 here."""
    table = Table(
        10, 3, 5, np.array([0, 4, 5, 6], np.int16), np.array([2, 4, 4, NOBODY], np.int16),
        np.array([3, 1, 2, 255], np.uint8),
        np.array([(223.5, 466.8), (293.6, 574.4), (114.4, 568.4), (0, 0)], np.float32),
        np.array([0, 1, 0, 0], np.uint8), np.array([0, Cls.RR, Cls.SR, Cls.SR], np.uint8),
    )  # fmt: skip
    lines = table_markdown(table).splitlines()
    assert lines[2] == "| dst | nxt | hop | location (m) | inv | cls | msr |"
    assert lines[4:] == [
        "| MS | 2 | 3 | (223.5, 466.8) |  | - | - |",
        r"| 4 | 4 | 1 | (293.6, 574.4) | \* | RR |  |",
        r"| 5 | 4 | 2 | (114.4, 568.4) |  | SR | \* |",
        "| 6 | - | ∞ | (0.0, 0.0) |  | SR |  |",
    ]
