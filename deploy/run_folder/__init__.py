"""The folder of one run: written while it goes on, read afterwards, compared with another's."""
