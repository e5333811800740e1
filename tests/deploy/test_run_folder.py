"""The files of a run, from snapshots, events and last counts."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.processes.operator_file import OPERATOR, living_launcher, read_operator
from deploy.run_folder.writer import RunFolder
from world.feed import Event, Snapshot
from world.terms import UNREACHABLE


@dataclass(frozen=True)
class OneVictim:
    victims_m: tuple[tuple[float, float], ...] = ((1.0, 2.0),)
    unreachable: float = 0.25
    unreachable_of: tuple[float, ...] = (0.0, 1 / 3)


@dataclass(frozen=True)
class TwoCells:
    name: str = "two_cells"
    seed: int = 7
    robots: int = 2
    radius_m: float = 20.0
    external: tuple[int, ...] = ()
    cell_names: tuple[str, ...] = ("a", "b")
    arena: OneVictim = OneVictim()

    def to_toml(self) -> str:
        return 'name = "two_cells"\n'


def snapshot(
    tick: int, rates: tuple[float, ...], hops: tuple[int, int] = (1, 2), present: tuple[int, int] = (1, 1)
) -> Snapshot:
    return Snapshot(
        tick=tick,
        nodes=np.array([1, 2], np.int16),
        present=np.array(present, np.uint8),
        xy_m=np.zeros((2, 2)),
        cls=np.array([1, 0], np.uint8),
        mode=np.zeros(2, np.uint8),
        hops=np.array(hops, np.uint8),
        nms=np.array([0, 1], np.int16),
        msr=np.array([2, -1], np.int16),
        target_m=np.zeros((2, 2)),
        search_rate=rates,
        merged=tick,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Any:
    with RunFolder(tmp_path / "run", TwoCells()) as made:  # type: ignore[arg-type]
        yield made


def test_one_row_per_simulated_second_even_if_the_feed_has_gaps(folder: RunFolder) -> None:
    for tick in [*range(25), *range(31, 45)]:
        folder.snapshot(snapshot(tick, (0.5, 0.0)))
    folder.finish({}, 1.0)
    rows = list(csv.DictReader((folder.path / "metrics.csv").read_text().splitlines()))
    assert [row["time_s"] for row in rows] == ["0.0", "1.0", "2.0", "3.1", "4.0"]
    assert rows[0]["relays"] == "1"
    assert rows[0]["mean_hops"] == "1.5"
    assert rows[0]["search_rate_a"] == "0.5"


def test_without_last_counts_the_snapshots_speak(folder: RunFolder) -> None:
    folder.snapshot(snapshot(0, (0.5, 0.0)))
    folder.snapshot(snapshot(1, (1.0, 0.2), hops=(1, UNREACHABLE)))
    folder.snapshot(snapshot(2, (1.0, 1.0), hops=(4, 5), present=(1, 0)))
    summary = folder.finish({}, 2.0, status="failed", failures=["world (pid 1) ended by SIGKILL"])
    assert summary["status"] == "failed"
    assert summary["search_rate"] == {"a": 1.0, "b": 1.0}
    assert summary["search_time_s"] == {"a": 0.1, "b": 0.2, "all": 0.2}
    assert summary["connected_fraction"] == 0.8
    assert summary["max_hops"] == 4, "an absent robot's hops do not count"
    assert (summary["ticks"], summary["simulated_s"], summary["real_time_factor"]) == (3, 0.3, 0.15)
    assert summary["trace_sha256"] is None
    unknown = dict.fromkeys(("made", "buffered", "discarded", "lost", "foreign"))
    assert summary["scan_reports"] == unknown | {"merged": 2}
    assert summary["information_age"] == {"median_s": None, "p95_s": None}
    assert (summary["walked_m"], summary["longest_absence_s"]) == (None, 0.1)
    assert summary["victims"] == {"placed": 1, "found": 0}
    assert summary["unreachable"] == {"floor": 0.25, "cells": {"a": 0.0, "b": 0.333333}}
    assert json.loads((folder.path / "summary.json").read_text()) == summary


def test_last_counts_overrule_the_snapshots(folder: RunFolder) -> None:
    folder.snapshot(snapshot(0, (0.5, 0.0)))
    finals: dict[str, dict[str, Any]] = {
        "world": {
            "status": "searched", "ticks": 20,
            "scan_reports": {"made": 9, "buffered": 1, "discarded": 0},
            "walked_m": 12.5, "longest_absence_s": 0.7, "scan_ticks": {"1/0": [3]},
            "made": {"1/0": 4, "2/1": 5}, "acknowledged": {"1": [0, 5], "2": [1, 3]},
        },
        "medium": {"trace_sha256": "ab", "frames": {"sent": 4}},
        "station": {
            "search_rate": {"a": 1.0, "b": 1.0}, "merged": 8, "victims_found": [0],
            "complete": {"1/0": 5, "2/1": 1}, "ahead": {"2/1": [4, 6]}, "contradicted": 1,
            "merged_ticks": {"1/0": [[1, 8]]},
        },
    }  # fmt: skip
    summary = folder.finish(finals, 4.0)
    assert summary["status"] == "searched"
    assert (summary["simulated_s"], summary["real_time_factor"]) == (2.0, 0.5)
    assert summary["scan_reports"] == {"made": 9, "merged": 8, "buffered": 1, "discarded": 0, "lost": 3, "foreign": 2}
    assert summary["victims"] == {"placed": 1, "found": 1}
    assert summary["information_age"] == {"median_s": 0.5, "p95_s": 0.5}
    assert (summary["walked_m"], summary["longest_absence_s"]) == (12.5, 0.7)
    assert (summary["trace_sha256"], summary["frames"]) == ("ab", {"sent": 4})


def test_events_are_on_disk_as_soon_as_they_happen(folder: RunFolder) -> None:
    folder.event(Event(1234, "fault", 4, "robot 4 is killed", {"verb": "kill"}))
    line = json.loads((folder.path / "events.jsonl").read_text())
    assert line == {
        "tick": 1234, "at_s": 123.4, "kind": "fault", "node": 4, "text": "robot 4 is killed", "data": {"verb": "kill"},
    }  # fmt: skip


def test_a_run_lives_as_long_as_its_launcher(tmp_path: Path) -> None:
    assert living_launcher(tmp_path) is None
    (tmp_path / OPERATOR).write_text('{"launcher": 1}')
    assert living_launcher(tmp_path) == 1
    (tmp_path / OPERATOR).write_text('{"launcher": 4194305}')
    assert living_launcher(tmp_path) is None, "no pid is that high"
    for content in ("", "[]", '{"launcher": -1}', '{"launcher": 0}', '{"launcher": "1"}', "[" * 10**5, "9" * 5000):
        (tmp_path / OPERATOR).write_text(content)
        assert living_launcher(tmp_path) is None
        with pytest.raises(ValueError, match=OPERATOR) as refused:
            read_operator(tmp_path)
        assert len(str(refused.value)) < 300
