"""Studies: many runs of one scenario along axes, from the plan to results, statistics and plots."""
