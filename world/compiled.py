"""Compiled forms of the few loops that take most of a tick: None unless `make compiled` built them.

Without them the same is done in Python, numpy and SciPy, with the same results to the bit (tests/test_compiled.py).
"""

from __future__ import annotations

from types import ModuleType

__all__ = ["kernels"]

kernels: ModuleType | None
try:
    from world import _kernels

    kernels = _kernels
except ImportError:
    kernels = None
