"""Tests of scenarios, run folders, studies and pages: whatever needs no processes of a run."""
