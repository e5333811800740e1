"""The page about a run, or about two: one HTML file that loads nothing."""
