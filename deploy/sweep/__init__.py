"""Studies: many runs of one scenario along axes, from the plan to the tables, statistics and plots."""
