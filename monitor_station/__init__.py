"""The monitor station: a DSDV node without wheels that merges what reaches it, and the recorder."""
