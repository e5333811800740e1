"""Tests of the monitor station and its recording."""
