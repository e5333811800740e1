"""Mutants: the rules are changed one at a time in a copy of the sources, and the tests have to notice."""
