"""One line of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field

from world.terms import TICK_S

__all__ = ["Row"]


@dataclass
class Row:
    """One run and its cost."""

    what: str
    """processes, in-process, or the name of a floor"""
    robots: int
    simulated_s: float
    factor: float
    """Real-time factor of the ticks, without start-up and end."""
    cpu_ms_per_tick: float
    """Processor time of all processes together."""
    p50_ms: float | None
    p99_ms: float | None
    recording: bool | None = None
    start_s: float | None = None
    """From the command to the first tick."""
    private_mb: dict[str, float] = field(default_factory=dict)
    trace_sha256: str | None = None
    mean_degree: float | None = None
    """Neighbors in range of each other, over robots and ticks."""

    @property
    def ticks_per_s(self) -> float:
        return self.factor / TICK_S

    @property
    def cpu_us_per_robot_tick(self) -> float:
        return self.cpu_ms_per_tick * 1e3 / self.robots

    @property
    def agent_mb(self) -> float | None:
        """Highest unique set size of a robot's process."""
        return max((mb for name, mb in self.private_mb.items() if name.startswith("robot/")), default=None)
