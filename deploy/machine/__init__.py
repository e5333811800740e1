"""What a run takes of the machine that it is on: signals, standard streams, temporary files, limits."""
