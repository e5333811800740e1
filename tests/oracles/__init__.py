"""The compiled loops written again in Python, numpy or SciPy, for a comparison to the bit."""
