"""The tests, and longer measurements (bench, acceptance, chaos, soak)."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
"""The checkout."""
