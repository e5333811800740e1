"""The monitor station: a DSDV node that does not move and merges the scans that reach it; and the recorder."""
