"""The benchmark: `make bench`, or `make bench ARGS="--quick --json bench.json"`."""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.bench.fine_maps import Cost, fine_maps
from tests.bench.floors import FLOORS, run_floor
from tests.bench.mission import machine, mission, simulated
from tests.bench.recording import paired, recorder_cost
from tests.bench.row import Row
from tests.bench.scaling import Point, scaling
from world.own_file import ForeignFileError, require_own, write_whole


@dataclass(frozen=True)
class Plan:
    """Durations of all measurements."""

    seconds: dict[int, float]
    """Simulated seconds of a mission in processes, by number of robots."""
    simulated_s: dict[int, float]
    """The same in one process."""
    floor_s: float
    """Wall time of a floor."""
    pairs: int
    recorder_ticks: int
    scaling_ticks: int
    fine_ticks: int


QUICK = Plan({9: 30.0, 30: 8.0, 100: 2.0}, {9: 20.0, 100: 2.0}, 1.5, 1, 1_000, 20, 100)
FULL = Plan({9: 4000.0, 30: 120.0, 100: 30.0}, {9: 4000.0, 100: 60.0}, 8.0, 5, 12_000, 200, 600)
SCENARIOS = {9: "three_cells", 30: "three_cells_wide", 100: "hundred"}


def main() -> None:
    """Run everything, print the tables, write the JSON."""
    options = _parser().parse_args()
    if options.map is not None and not options.fine_maps:
        _parser().error("--map: only with --fine-maps")
    if options.json is not None:
        _require_place(options.json)
    console = Console(width=155)
    plan = QUICK if options.quick else FULL
    sizes = options.robots or sorted(SCENARIOS)
    if options.scaling or options.fine_maps:
        points = scaling(plan.scaling_ticks) if options.scaling else fine_maps(plan.fine_ticks, options.map)
        _show(console, points, options.json)
        return
    rows: list[Row] = []
    for row in _rows(plan, sizes):
        rows.append(row)
        cost = f"{row.cpu_ms_per_tick:.2f} ms of processor time per tick"
        console.print(f"{row.what} {row.robots}: {row.factor:.2f} times real time, {cost}", highlight=False)
    recorder = [recorder_cost(robots, plan.recorder_ticks) for robots in (9, 100) if robots in sizes]
    on_off = paired(lambda on: mission("three_cells", 9, min(60.0, plan.seconds[9]), recording=on), plan.pairs)
    console.print(_table(rows))
    console.print("recorder on made-up missions:", *recorder, f"\nrecording on against off, 9 robots: {on_off}")
    if options.json is not None:
        content = {"machine": machine(), "rows": [_plain(row, rows) for row in rows]}
        write_whole(options.json, json.dumps(content | {"recorder": recorder, "recording": on_off}, indent=1) + "\n")


def _require_place(file: Path) -> None:
    """Look before all that is measured whether it can be written, and is not in place of a file of the user's."""
    try:
        require_own(file, '"machine":')
        if not os.access(file.parent, os.W_OK):
            raise ForeignFileError(f"{file}: can't write there")
    except (OSError, ForeignFileError) as error:
        _parser().error(f"--json: {error}")


def _show(console: Console, measured: Iterator[Point] | Iterator[Cost], file: Path | None) -> None:
    points = []
    for point in measured:
        points.append(dataclasses.asdict(point))
        console.print(point, highlight=False)
    if file is not None:
        write_whole(file, json.dumps({"machine": machine(), "points": points}, indent=1) + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under two minutes")
    parser.add_argument("--scaling", action="store_true", help="only how the cores' cost grows, in one process")
    parser.add_argument("--fine-maps", action="store_true", help="only what fine maps cost, in one process")
    parser.add_argument("--map", type=Path, metavar="FILE", help="with --fine-maps: this map instead of an own one")
    parser.add_argument("--robots", type=int, action="append", choices=sorted(SCENARIOS), help="only this size")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there, too")
    return parser


def _rows(plan: Plan, sizes: list[int]) -> Iterator[Row]:
    """Of each size all that is compared, close together in time."""
    for robots in sizes:
        scenario = SCENARIOS[robots]
        for floor in FLOORS:
            yield run_floor(floor, robots, plan.floor_s)
        for recording in (False, True):
            yield mission(scenario, robots, plan.seconds[robots], recording=recording)
        if robots in plan.simulated_s:
            yield simulated(scenario, robots, plan.simulated_s[robots])


def _ratios(row: Row, rows: list[Row]) -> dict[str, float]:
    """Real-time factor of a row over each floor of its size."""
    if row.what != "processes":
        return {}
    floors = {r.what.removeprefix("floor "): r.factor for r in rows if r.what != row.what and r.robots == row.robots}
    return {name: row.factor / floors[name] for name in FLOORS if name in floors}


def _plain(row: Row, rows: list[Row]) -> dict[str, Any]:
    derived = {
        "ticks_per_s": row.ticks_per_s,
        "cpu_us_per_robot_tick": row.cpu_us_per_robot_tick,
        "agent_mb": row.agent_mb,
        "of_floor": _ratios(row, rows),
    }
    return dataclasses.asdict(row) | derived


def _table(rows: list[Row]) -> Table:
    table = Table(box=None, pad_edge=False)
    heads = (
        "run", "robots", "recording", "factor", "ticks/s", "CPU us per robot, tick", "p50 ms", "p99 ms", "start s",
        "MB per agent", "station MB", *(f"of {name}" for name in FLOORS),
    )  # fmt: skip
    for head in heads:
        table.add_column(head, justify="left" if head == "run" else "right")
    for row in rows:
        ratios = _ratios(row, rows)
        table.add_row(
            row.what, str(row.robots), {True: "on", False: "off", None: ""}[row.recording],
            f"{row.factor:.2f}", f"{row.ticks_per_s:.1f}", f"{row.cpu_us_per_robot_tick:.0f}",
            _number(row.p50_ms, 2), _number(row.p99_ms, 2), _number(row.start_s, 2), _number(row.agent_mb, 1),
            _number(row.private_mb.get("station"), 1), *(_number(ratios.get(name), 2) for name in FLOORS),
        )  # fmt: skip
    return table


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    main()
