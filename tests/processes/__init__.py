"""Tests that start the processes of a run."""
