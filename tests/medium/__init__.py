"""Tests of the radio."""
