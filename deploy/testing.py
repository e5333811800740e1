"""The fixture `emulation` under its older name; pytest finds it without an import (docs/faults.md)."""

from __future__ import annotations

from deploy.emulation import Emulation, EmulationError
from vds.pytest_plugin import emulation

__all__ = ["Emulation", "EmulationError", "emulation"]
