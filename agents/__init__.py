"""One robot: routing, class, path recovery, exploration, mapping. It knows what it sensed and what it heard."""
