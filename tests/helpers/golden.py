"""Four short missions, and the digests of their traces: `python -m tests.helpers.golden` prints what they are now.

A digest changes only in a commit of its own that says why.
"""

from __future__ import annotations

import sys
from typing import Any, Final

from deploy.scenario import load
from deploy.simulation import Simulation

MISSIONS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "vds": ("three_cells", {"robots": 9, "duration_s": 120.0, "seed": 1}),
    "scout behind walls": (
        "three_cells",
        {"robots": 12, "radius_m": 15.0, "policy": "scout", "radio.model": "disk_los", "duration_s": 120.0, "seed": 2},
    ),
    "sortie behind walls": (
        "cluttered_room",
        {"robots": 4, "policy": "sortie", "radio.model": "disk_los", "duration_s": 100.0, "seed": 4},
    ),
    "noise and losses": (
        "office_floor",
        {
            "radio.model": "log_distance", "radio.shadowing_db": 3.0, "radio.loss": 0.05, "lidar.noise_m": 0.02,
            "duration_s": 60.0, "seed": 3, "fault": ["kill:random@20", "restart:2@30+5", "pause:3@40+4"],
        },
    ),
    "a poor radio": (
        "three_cells",
        {
            "robots": 6, "duration_s": 40.0, "seed": 4, "policy": "scout", "radio.model": "log_distance",
            "radio.shadowing_db": 3.0, "radio.shadowing_correlation_m": 5.0, "radio.fading": "rician",
            "radio.burst_share": 0.1, "radio.burst_loss": 0.9, "radio.bandwidth_bytes_s": 6000.0,
            "radio.channel_bytes_s": 30_000.0, "fault": ["restart:2@10+5", "pause:3@20+4", "restart:station@25+3"],
        },
    ),
}  # fmt: skip
DIGESTS: Final = {
    "vds": "cf3d88415520caf5a3c1038c6f9d88e5ebd539c89b67326f9088eeaa8cea3c08",
    "scout behind walls": "9f9cb5ed742d7e168fea5e947443982946ac4a7a6ab289a95b017ca4f7e24b54",
    "sortie behind walls": "40b25fffed0c59cb62f188cc5938cd9fa05535d160189936cb64a5915b7e4ab3",
    "a poor radio": "7e5b862540fe7717edb393f8ac3fef66c2e3447cff4b62969e75882adaa89f44",
    "noise and losses": "ea2cc2ccb24d72ecd9ab62a10dca91b29fb1c8878deb27a2e9f885623e5d97c6",
}


def digest(name: str) -> str:
    """Trace digest of one of the missions."""
    scenario, overrides = MISSIONS[name]
    return Simulation(load(scenario, overrides)).run().trace_sha256


if __name__ == "__main__":
    for name in sys.argv[1:] or MISSIONS:
        print(digest(name))
