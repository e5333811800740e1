"""Six short missions, and the digests of their traces: `python -m tests.helpers.golden` prints what they are now.

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
        {
            "robots": 4, "policy": "sortie", "radio.model": "disk_los", "body_radius_m": 0.0,
            "duration_s": 100.0, "seed": 4,
        },
    ),
    "bodies": (
        "hospital_ward",
        {
            "robots": 10, "policy": "sortie", "radio.model": "disk_los", "body_radius_m": 0.25,
            "duration_s": 60.0, "seed": 5, "fault": ["kill:3@15", "pause:4@25+5"],
        },
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
    "vds": "e5aeef77b8f8fe4be0b6aa20dd50aa26c87c7f6ca24eaa364ab9dc2cdc289e9f",
    "scout behind walls": "37af168714656b4b65078548d2c5c5eb5c7752af9baf756f3b00cb8ba6f3e022",
    "sortie behind walls": "6a77f85bb451c1aefa2add3fa30ad3e2a75dc253513faf59385d54720fa8b537",
    "bodies": "792583c6e503ded3389fedd728ae3d12727463c5503a504199a986a96bf8030a",
    "a poor radio": "782dcdb529e19140f0842d877ca23a8e608b1d892bcf16155dd298ff233e3818",
    "noise and losses": "8e1280805c164ba130f009f30996c46766d7640ae3855504772ffe3960129ad9",
}


def digest(name: str) -> str:
    """Trace digest of one of the missions."""
    scenario, overrides = MISSIONS[name]
    return Simulation(load(scenario, overrides)).run().trace_sha256


if __name__ == "__main__":
    for name in sys.argv[1:] or MISSIONS:
        print(digest(name))
