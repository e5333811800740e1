"""Ground truth, and the judge of who takes part in a tick."""
