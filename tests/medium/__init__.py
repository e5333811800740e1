"""Tests of the medium."""
