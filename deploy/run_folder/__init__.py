"""The folder of one run: written during the run, read afterwards, compared with that of another run."""
