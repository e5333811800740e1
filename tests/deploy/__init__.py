"""Tests of scenarios, run folders, studies and pages: all that needs no processes of a run."""
