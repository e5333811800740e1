"""The fixture `emulation` under its older name, `from deploy.testing import emulation`; pytest finds it without (docs/faults.md)."""

from __future__ import annotations

from deploy.emulation import Emulation, EmulationError
from vds.pytest_plugin import emulation

__all__ = ["Emulation", "EmulationError", "emulation"]
