"""The tests, and longer measurements (bench, acceptance, chaos)."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
"""The checkout."""
