"""Results of the studies against the claims of the paper and the numbers of a prototype."""
