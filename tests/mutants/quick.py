"""Plug-in for pytest: a failing example is found as always, the same at each run, but not made small."""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings

PROFILE = "quick"

settings.register_profile(
    PROFILE,
    phases=(Phase.explicit, Phase.generate),
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
