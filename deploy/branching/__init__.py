"""Runs with one past and many futures: `branch` gives each the result of a whole run, at the cost of what differs."""

from deploy.branching.branches import BranchError, branch

__all__ = ["BranchError", "branch"]
