"""Tests of the robots' cores."""
