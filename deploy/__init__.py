"""Scenarios, and what launches them."""
