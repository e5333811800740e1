"""Scenarios, the processes of a run, studies and reports; the commands."""
