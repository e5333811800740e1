"""What a robot knows before it starts: its own constants, never the true map nor who else is there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from world.grid import GridGeometry

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Ticks = Annotated[int, Ge(0)]
Share = Annotated[float, Ge(0), Le(1)]

KM_H = 1 / 3.6

POWER_SMOOTHING_S: Final = 1.0
"""Over how long received power is smoothed where shadowing makes it jump."""


@dataclass(frozen=True)
class Routing:
    """DSDV and the sticky route to the MS (PROCEDURE 1 and 2)."""

    neighbor_timeout_ticks: Annotated[int, Ge(1)] = 10
    """A neighbor not heard for this long is gone."""
    silence_ticks: Annotated[int, Ge(1)] = 5
    """Rule A: a neighbor silent for this long counts as beyond r_in and r_out."""
    sticky: bool = True
    """The MS entry is refreshed by the present NMS only. False: plain minimum-hop DSDV."""
    probe_probability: Share = 0.5
    """2b: chance per tick to stop refreshing while the link is weak."""
    probe_ticks: Ticks = 5
    """2b: how long it stops refreshing at most."""
    adopt_share: Positive = 0.9
    """2b: a potential NMS is nearer than this share of r_in."""
    shortcut_share: NotNegative = 0.65
    """2c: a neighbor nearer than this share of r_t that saves a hop is adopted; 0 = never."""
    quiet_restart: bool = True
    """A new incarnation neither sends nor learns routes for the neighbor timeout + 1."""
    r_in_share: Positive = 0.8
    """r_in / r_t (paper, II-B; the value is ours)."""
    r_out_share: Positive = 0.9
    """r_out / r_t."""

    def quiet_until(self, incarnation: int, first_tick: int) -> int:
        """First tick at which a node that starts at `first_tick` sends and learns routes (PROCEDURE 2)."""
        quiet = incarnation > 0 and self.quiet_restart
        return first_tick + self.neighbor_timeout_ticks + 1 if quiet else first_tick


@dataclass(frozen=True)
class Classing:
    """SRRC (PROCEDURE 3)."""

    sr_after_ticks: Ticks = 10
    """Back to SR after inv was empty for this long."""
    msr_margin_m: NotNegative = 2.0
    """A new MSR is at least this much farther from the MS than the present one."""
    msr_compare_ticks: Annotated[int, Ge(1)] = 10
    """How often a relay compares distances as long as its MSR stays eligible: nobody moves far in a second."""
    copy_target: bool = True
    """A relay takes its MSR's target at every tick (paper, II-C)."""


@dataclass(frozen=True)
class Moving:
    """Speeds (paper, III) and how a robot walks."""

    speed_m_s: Positive = 1.0 * KM_H
    trace_speed_m_s: Positive = 2.0 * KM_H
    """When it traces another robot, and in recovery."""
    arrive_m: Positive = 0.25
    """A target is reached within this distance."""
    relay_walks: bool = True
    """Relays walk to their target too (PROCEDURE 4.4)."""


@dataclass(frozen=True)
class Exploring:
    """Decision-theoretic choice of frontiers (Burgard et al. 2005) and the stall rule (PROCEDURE 5)."""

    utility_m: Positive = 20.0
    """Worth of an undiscounted frontier, in metres of path."""
    discount_m: Positive = 8.0
    """Announced targets of other SRs within this distance discount a frontier."""
    reselect_when_seen: bool = True
    """Choose anew as soon as the target is no frontier any more, not on arrival only."""
    stall: bool = True
    stall_move_m: Positive = 1.0
    stall_move_s: Positive = 20.0
    stall_path_m: Positive = 1.0
    stall_path_s: Positive = 60.0
    taboo_s: Positive = 60.0
    taboo_radius_m: Positive = 8.0
    progress_cells: Annotated[int, Ge(1)] = 40
    """New cells after which stalls in a row are forgotten."""
    retreat_after: Annotated[int, Ge(1)] = 3
    retreat_probability: Share = 0.5
    retreat_min_s: Positive = 30.0
    retreat_max_s: Positive = 90.0


@dataclass(frozen=True)
class Reporting:
    """Scans up to the MS, map down from it (DESIGN 5)."""

    store_and_forward: bool = True
    """Deliver after reconnection what was scanned while cut off. False: the paper's rule, discard it."""
    resend_min_s: Positive = 1.0
    chunk_cells: Annotated[int, Ge(1)] = 2000
    """Map changes that one frame carries at most."""


@dataclass(frozen=True)
class Scouting:
    """Policy scout (agents/scout.py); each rule can be switched off alone."""

    predict: bool = True
    """B: stand rather than walk out of the predicted reach of the NMS. The rules below that rest on it go with it."""
    shield: bool = True
    """C: stand rather than let a wall come between oneself and a child, and ask the child to yield."""
    hurry: bool = True
    """D: walk at the tracing speed, but for the last metres of a search robot."""
    hurry_beyond_m: NotNegative = 10.0
    recruit: bool = True
    """Give up one's own target for that of a deeper robot in need."""
    wait: bool = True
    """A robot in need is patient while help may come."""
    stretch: bool = True
    """Let a chain in need reach farther."""
    need_max_ticks: Ticks = 70
    need_ticks: Ticks = 50
    """Stopped for this long is need."""
    need_decay_ticks: Ticks = 5
    recall_s: NotNegative = 10.0
    """Need that ended this recently still recruits."""
    deeper_m: NotNegative = 2.0
    wait_move_s: Positive = 90.0
    wait_path_s: Positive = 270.0
    stretch_share: Positive = 0.95
    """r_in' / r_t while stretched."""
    relax_share: Positive = 0.6
    """Stretching ends when d_in falls below this share of r_in."""
    wall_loss_db: NotNegative | None = None
    """What the robots believe that a wall costs; None: what the radio's table says."""

    def wall_factor(self, model: str, wall_loss_db: float, exponent: float) -> float:
        """How many times farther away one wall makes a node seem, as the robots believe.

        Args:
            model: of the radio: disk, disk_los or log_distance.
            wall_loss_db: what a wall costs by the radio's table.
            exponent: of the path-loss curve.
        """
        if model == "disk":
            return 1.0
        if model == "disk_los":
            return math.inf
        loss_db = wall_loss_db if self.wall_loss_db is None else self.wall_loss_db
        factor: float = 10.0 ** (loss_db / (10.0 * exponent))
        return factor


@dataclass(frozen=True)
class Rules:
    """All rules of a robot's behavior."""

    routing: Routing = field(default_factory=Routing)
    classing: Classing = field(default_factory=Classing)
    moving: Moving = field(default_factory=Moving)
    exploring: Exploring = field(default_factory=Exploring)
    reporting: Reporting = field(default_factory=Reporting)
    scouting: Scouting = field(default_factory=Scouting)

    def check(self) -> None:
        """Check what no field can say alone.

        Raises:
            ValueError: one line that says what is wrong, the keys relative to the rules' table.
        """
        routing, exploring = self.routing, self.exploring
        if not routing.r_in_share < routing.r_out_share <= 1:
            shares = f"r_in_share = {routing.r_in_share:g}, r_out_share = {routing.r_out_share:g}"
            raise ValueError(f"routing: {shares}: needs r_in_share < r_out_share <= 1")
        if exploring.retreat_min_s > exploring.retreat_max_s:
            raise ValueError("exploring: needs retreat_min_s <= retreat_max_s")


@dataclass(frozen=True)
class RobotConfig:
    """One robot (or, without wheels, the MS's own DSDV node)."""

    node: int
    seed: int
    geometry: GridGeometry
    """The frame that all maps of the run share (paper: the global coordinate system)."""
    station_m: tuple[float, float]
    safety_zone_m: tuple[float, float, float, float]
    """x0, y0, x1, y1: known free from the start."""
    radius_m: float
    """r_t."""
    lidar_range_m: float
    lidar_beams: int
    tx_power_dbm: float
    loss_1m_db: float
    exponent: float
    """The path-loss curve that turns received power into distance."""
    power_smoothing_s: float = 0.0
    """Time constant over which received power is smoothed; 0 = not at all."""
    wall_factor: Annotated[float, Ge(1)] = 1.0
    """How many times farther away a wall in between makes a neighbor seem: 1 = no difference, inf = it blocks."""
    policy: str = "vds"
    """Who decides: vds, scout, or module:Class (agents/policies.py)."""
    rules: Rules = field(default_factory=Rules)
