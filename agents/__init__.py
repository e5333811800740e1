"""One robot: routing, class, path recovery, exploration, mapping. It knows only what it sensed and what it heard."""
