"""Results of the studies against the claims of the paper."""
