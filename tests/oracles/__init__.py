"""The compiled loops said again in Python, numpy or SciPy, to hold them against, bit for bit."""
