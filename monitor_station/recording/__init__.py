"""The recording of a run for Rerun's viewer."""
