"""Policies of a user's that fail, in a folder of their own."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

__all__ = ["CLIMBS", "policies"]

CLIMBS: Final = 30
"""Tick at which `climbing:Climbs` raises in every robot."""
_CLIMBING: Final = f"""
from agents.vds import Vds


class Climbs(Vds):
    def step(self):
        if self.body.tick == {CLIMBS}:
            raise ArithmeticError(f"robot {{self.body.config.node}} has had enough")
        return super().step()
"""


@pytest.fixture
def policies(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder, where Python finds its modules."""
    with tempfile.TemporaryDirectory(prefix="policies-") as folder:
        (Path(folder) / "climbing.py").write_text(_CLIMBING)
        monkeypatch.syspath_prepend(folder)
        before = set(sys.modules)
        yield Path(folder)
        for name in set(sys.modules) - before:
            if getattr(sys.modules[name], "__file__", "") and str(sys.modules[name].__file__).startswith(folder):
                del sys.modules[name]
