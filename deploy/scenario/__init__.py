"""A scenario: one file that says everything about a run, checked before anything starts."""

from deploy.scenario.files import names, parse_set
from deploy.scenario.loading import load, with_changes
from deploy.scenario.scenario import Scenario
from deploy.scenario.tables import ScenarioError

__all__ = ["Scenario", "ScenarioError", "load", "names", "parse_set", "with_changes"]
