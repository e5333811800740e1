"""What all failures of a mission come to: after how many of them is everybody back, and after which not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from bus.excerpt import shown
from deploy.command import call_of
from deploy.criticality.failure import Failure
from deploy.scenario import Scenario, with_changes
from world.terms import tick_of

__all__ = ["WITHIN_S", "Verdict", "case_of", "name_of", "verdict_on"]

WITHIN_S: Final = 60.0
"""Everybody is to have a path again within this time."""


@dataclass(frozen=True)
class Verdict:
    """Of a mission."""

    judged: int
    """Failures of which it is known whether everybody was back in time."""
    back: int
    harmful: Sequence[Mapping[str, Any]]
    """Rows after which somebody was not, the costliest first."""
    open: int
    """Failures after which the mission, or the horizon, ended too soon to tell."""

    @property
    def words(self) -> str:
        """One line."""
        if not self.judged:
            return "no failure could be judged"
        left = f"; {self.open} more came too late in the mission to tell" if self.open else ""
        share = self.back / self.judged
        return f"after {share:.1%} of {self.judged} single failures everybody is back within {WITHIN_S:g} s{left}"


def verdict_on(rows: Sequence[Mapping[str, Any]]) -> Verdict:
    """The verdict on these failures."""
    back = [row for row in rows if row["recovered"] and row["back_s"] <= WITHIN_S]
    late = [row for row in rows if row["recovered"] and row["back_s"] > WITHIN_S]
    never = [row for row in rows if not row["recovered"] and row["watched_s"] >= WITHIN_S]
    harmful = sorted([*late, *never], key=lambda row: (-row["cost_robot_s"], row["at_s"], row["robot"]))
    return Verdict(len(back) + len(harmful), len(back), harmful, len(rows) - len(back) - len(harmful))


def name_of(row: Mapping[str, Any], failure: Failure) -> str:
    """File name of a case."""
    return f"{failure.verb}-{row['robot']}-{row['at_s']:g}.toml"


def case_of(row: Mapping[str, Any], failure: Failure, scenario: Scenario) -> str:
    """The scenario of the mission with this failure, as TOML, with a comment that says what happens."""
    fault = failure.fault(row["robot"], tick_of(row["at_s"]))
    happens = (
        f"everybody is back only after {row['back_s']:g} s" if row["recovered"]
        else f"after {row['watched_s']:g} s somebody is still without a path"
    )  # fmt: skip
    who = f"{failure.verb} of robot {row['robot']} at {row['at_s']:g} s, with {row['orphans']} robots behind it"
    return (
        f"# {who}: {happens}.\n"
        f"# {call_of('run')} --scenario {shown(name_of(row, failure))}\n"
        f"{with_changes(scenario, [fault]).to_toml()}"
    )
