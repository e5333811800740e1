"""One analysis carried out while somebody looks on: the mission, a branch for each failure, and what comes of them."""

from __future__ import annotations

import contextlib
import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from deploy.branching.branches import BranchError, answers
from deploy.branching.trunk import Branch, Order
from deploy.command import call_of
from deploy.criticality.failure import Failure, fail, run_mission
from deploy.criticality.results import Results, Row
from deploy.criticality.verdict import case_of, name_of, verdict_on
from deploy.scenario import Scenario, with_changes
from deploy.sweep.row import code_version
from world.terms import seconds_of, tick_of

__all__ = ["Analysis", "row_of"]


@dataclass(frozen=True)
class Analysis:
    """What is asked for."""

    scenario: Scenario
    failure: Failure
    every_s: float
    """Between the moments at which each robot fails."""
    workers: int
    """Most branches at once."""

    @property
    def asked(self) -> dict[str, Any]:
        """All that decides the rows besides the scenario, in JSON types."""
        failure = self.failure
        return {
            "verb": failure.verb, "for_s": failure.for_s, "horizon_s": failure.horizon_s, "to_end": failure.to_end,
            "every_s": self.every_s, "code": f"{code_version()}-{_own_code()}",
        }  # fmt: skip

    def carry_out(self, folder: Path) -> int:
        """Run what is not done, then write tables, picture, verdict and cases of all that there is.

        Returns:
            How many branches did not come to their end, as by an exception of a policy; they have no row.

        Raises:
            ClaimError, ResultsError: the folder can't be used.
            BranchError: the mission did not come to its end.
            KeyboardInterrupt: the user's; all that there is has been written.
        """
        console = Console()
        with contextlib.closing(Results(folder, self.asked, self.scenario.to_toml())) as results:
            try:
                return self._run(results, console)
            finally:
                if rows := results.rows():
                    self._conclude(results, rows, console)
                else:
                    _say(
                        console,
                        "no failure has a result: none was tried to its end, or the mission ends before the first",
                    )

    def _run(self, results: Results, console: Console) -> int:
        failed = 0
        with _bar(console) as bar:
            mission = results.mission()
            if mission is None:
                task = bar.add_task("the mission as it is", total=None)
                mission = self._mission()
                results.note_mission(mission)
                bar.update(task, total=1, completed=1)
            done = {(row["robot"], row["at_s"]) for row in results.rows()}
            every = [(int(robot), int(tick)) for tick, there in mission["places"].items() for robot in there]
            todo = [(robot, tick) for robot, tick in every if (robot, seconds_of(tick)) not in done]
            task = bar.add_task("failures", total=len(every), completed=len(every) - len(todo))
            if todo:
                with contextlib.closing(answers(self._order(todo))) as told:
                    for key, answer in told:
                        if isinstance(answer, BranchError):
                            failed += 1
                            bar.console.print(f"failed: {answer}", markup=False, highlight=False, soft_wrap=True)
                        else:
                            results.add(row_of(key, answer, mission, self.failure))
                        bar.advance(task)
        return failed

    def _mission(self) -> dict[str, Any]:
        task = functools.partial(run_mission, every=tick_of(self.every_s))
        order = Order(self.scenario, [Branch("mission", 0, self.scenario)], task, 1, keeps=False)
        ((_, mission),) = answers(order)
        if isinstance(mission, BranchError):
            raise mission
        return dict(mission)

    def _order(self, todo: Sequence[tuple[int, int]]) -> Order:
        branches = [
            Branch(f"{robot}@{tick}", tick, with_changes(self.scenario, [self.failure.fault(robot, tick)]))
            for robot, tick in todo
        ]
        return Order(self.scenario, branches, functools.partial(fail, failure=self.failure), self.workers, keeps=False)

    def _conclude(self, results: Results, rows: list[Row], console: Console) -> None:
        from deploy.criticality.picture import draw  # late: Matplotlib takes a second

        verdict, failure, scenario = verdict_on(rows), self.failure, self.scenario
        results.write_tables(rows)
        cases = {name_of(row, failure): case_of(row, failure, scenario) for row in verdict.harmful}
        results.write_cases(cases)
        results.note_verdict({
            "verdict": verdict.words, "failures": len(rows), "judged": verdict.judged, "back": verdict.back,
            "open": verdict.open, "cases": [f"cases/{name}" for name in cases],
        })  # fmt: skip
        title = f"{scenario.name}, {scenario.robots} robots, policy {scenario.tables.policy}"
        paths = draw(rows, verdict, scenario.arena, self.every_s, title, failure.verb, results.folder)
        _say(console, verdict.words)
        if cases:
            worst = next(iter(cases))
            _say(console, f"{len(cases)} failures after which not, such as: {call_of('run')} --scenario "
                 f"{results.folder / 'cases' / worst}")  # fmt: skip
        _say(console, f"table: {results.folder / 'criticality.csv'}, picture: {paths[0]}")


@functools.cache
def _own_code() -> str:
    """Digest of what decides a row besides the run: this room's sources, and those of branches."""
    digest = hashlib.sha256()
    for room in ("criticality", "branching"):
        for path in sorted((Path(__file__).parent.parent / room).glob("*.py")):
            digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def row_of(key: str, told: dict[str, Any], mission: dict[str, Any], failure: Failure) -> Row:
    """The row of a failure, from what its branch told and what the mission was without it."""
    robot, _, tick = key.partition("@")
    begun, x_y = int(tick), mission["places"][tick][robot]
    anyway = sum(mission["missing"][begun : begun + tick_of(told["watched_s"])])
    row: Row = {
        "robot": int(robot), "at_s": seconds_of(begun), "verb": failure.verb, "x_m": x_y[0], "y_m": x_y[1],
        "orphans": told["orphans"], "recovered": told["recovered"], "back_s": told["back_s"],
        "without_path_robot_s": told["without_path_robot_s"], "anyway_robot_s": seconds_of(anyway),
        "cost_robot_s": max(0.0, round(told["without_path_robot_s"] - seconds_of(anyway), 1)),
        "watched_s": told["watched_s"], "ended": told["ended"],
    }  # fmt: skip
    if failure.to_end:
        took, before = told["search_time_s"], mission["search_time_s"]
        row["search_time_lost_s"] = None if took is None or before is None else round(took - before, 1)
        ours = told["victims"]
        theirs = {victim: at for victim, at in mission["victims"].items() if at >= begun}  # the others are both runs'
        row["victims_later"] = sum(v in ours and ours[v] > at for v, at in theirs.items())
        row["victims_missed"] = sum(victim not in ours for victim in theirs)
    return row


def _bar(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    return Progress(*columns, console=console, speed_estimate_period=600.0)


def _say(console: Console, words: str) -> None:
    console.print(words, markup=False, highlight=False, soft_wrap=True)
