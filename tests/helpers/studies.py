"""Small studies, and the command that runs them."""

from __future__ import annotations

import sys
from pathlib import Path

from tests import ROOT

TINY = """
scenario = "three_cells"
plot = "search_time"
[set]
robots = 2
duration_s = {duration}
[axes]
radius_m = [20.0]
seed = "1..{seeds}"
"""


def tiny(folder: Path, seeds: int, duration: float) -> Path:
    """The file of a study of so many runs of so many simulated seconds."""
    path = folder / "tiny.toml"
    path.write_text(TINY.format(seeds=seeds, duration=duration))
    return path


def command(*arguments: object) -> list[str]:
    """`deploy/study.py` with these arguments."""
    return [sys.executable, str(ROOT / "deploy" / "study.py"), *map(str, arguments)]
