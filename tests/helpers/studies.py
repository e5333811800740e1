"""Small studies, the command that runs them, and synthetic rows of results."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

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


def row(robots: int, radius_m: float, seed: int, time_s: float | None, **more: Any) -> dict[str, Any]:
    """A synthetic row."""
    status = "time_limit" if time_s is None else "searched"
    return {
        "key": f"{robots}-{radius_m}-{seed}-{more.get('variant', 'base')}", "variant": "base", "engine": "in-process",
        "scenario": "synthetic", "seed": seed, "robots": robots, "radius_m": radius_m, "status": status,
        "error": None, "duration_s": 2000.0, "connected_fraction": 0.9, "search_time_s.all": time_s,
        "search_time_s.1": time_s, "search_time_s.2": time_s, "search_rate.1": float(time_s is not None),
        "search_rate.2": float(time_s is not None), **more,
    }  # fmt: skip


def rates(first: list[float], second: list[float]) -> dict[str, list[float]]:
    """A time series of two cells, one value per second."""
    return {"time_s": [float(i) for i in range(len(first))], "1": first, "2": second}
