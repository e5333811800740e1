"""What a robot knows before it starts: its own constants. Of the other robots it knows the number."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Final

from annotated_types import Ge, Le

from world.grid import GridGeometry
from world.terms import MAX_NODE, MOST, NotNegative, Positive

Ticks = Annotated[int, Ge(0), Le(MOST)]
Count = Annotated[int, Ge(1), Le(MOST)]
Share = Annotated[float, Ge(0), Le(1)]

KM_H = 1 / 3.6
MOST_DECADES: Final = 300.0
"""The largest exponent of ten that is used: 10^300 is still a finite double."""

POWER_SMOOTHING_S: Final = 1.0
"""Time constant over which robots smooth received power where there is shadowing [paper 5.4]."""


@dataclass(frozen=True)
class Routing:
    """DSDV and the sticky route to the MS [paper 2.6 to 3.7]."""

    neighbor_timeout_ticks: Count = 10
    """A neighbor from which nothing was heard for this long is gone [paper 2.8]."""
    silence_ticks: Count = 5
    """Rule A: a neighbor that is silent for this long counts as beyond r_in and r_out [paper 3.7]."""
    sticky: bool = True
    """Only the present NMS refreshes the MS's entry [paper 3.2]. False: plain minimum-hop DSDV."""
    probe_probability: Share = 0.5
    """Rule b [paper 3.4]: chance per tick to stop refreshing while the link is weak."""
    probe_ticks: Ticks = 5
    """Rule b: how long the robot stops refreshing at most."""
    adopt_share: Positive = 0.9
    """Rule b: a potential NMS is nearer than this share of r_in."""
    shortcut_share: NotNegative = 0.65
    """Rule c [paper 3.5]: a neighbor nearer than this share of r_t that saves a hop is adopted; 0 = never."""
    quiet_restart: bool = True
    """A new incarnation sends and learns no routes for the neighbor time-out and one tick [paper 2.10]."""
    r_in_share: Positive = 0.8
    """r_in / r_t [paper 5.1, 5.2]."""
    r_out_share: Positive = 0.9
    """r_out / r_t."""

    def quiet_until(self, incarnation: int, first_tick: int) -> int:
        """First tick at which a node that starts at `first_tick` sends and learns routes [paper 2.10]."""
        quiet = incarnation > 0 and self.quiet_restart
        return first_tick + self.neighbor_timeout_ticks + 1 if quiet else first_tick


@dataclass(frozen=True)
class Classing:
    """SRRC [paper 4.1 to 4.8]."""

    sr_after_ticks: Ticks = 10
    """A robot becomes an SR again after its inv was empty for this long [paper 4.2]."""
    msr_margin_m: NotNegative = 2.0
    """A new MSR is at least this much farther from the MS than the present one [paper 4.5]."""
    msr_compare_ticks: Count = 10
    """How often a relay compares distances while its MSR stays eligible [paper 4.6]."""
    copy_target: bool = True
    """A relay takes its MSR's target at every tick [paper 4.7]."""


@dataclass(frozen=True)
class Moving:
    """Speeds, and how a robot walks [paper 5.9, 5.10]."""

    speed_m_s: Positive = 1.0 * KM_H
    trace_speed_m_s: Positive = 2.0 * KM_H
    """When the robot traces another one, and in path recovery."""
    arrive_m: Positive = 0.25
    """A target counts as reached within this distance [paper 6.4]."""
    relay_walks: bool = True
    """Relays walk to their target too [paper 5.10]."""


@dataclass(frozen=True)
class Exploring:
    """Decision-theoretic choice of frontiers (Burgard et al. 2005) and the stall rule [paper 6.1 to 6.6]."""

    utility_m: Positive = 20.0
    """Worth of an undiscounted frontier, in metres of path."""
    discount_m: Positive = 8.0
    """Announced targets of other SRs within this distance discount a frontier."""
    reselect_when_seen: bool = True
    """Choose a new target as soon as the present one is no frontier any more, not only on arrival [paper 6.3]."""
    stall: bool = True
    """Declare frontiers near a target taboo when the robot does not get there [paper 6.5]."""
    stall_move_m: Positive = 1.0
    stall_move_s: Positive = 20.0
    stall_path_m: Positive = 1.0
    stall_path_s: Positive = 60.0
    taboo_s: Positive = 60.0
    taboo_radius_m: Positive = 8.0
    progress_cells: Count = 40
    """New cells that end a row of stalls."""
    retreat_after: Count = 3
    retreat_probability: Share = 0.5
    """Chance to walk back towards the MS when every frontier is taboo [paper 6.6]."""
    retreat_min_s: Positive = 30.0
    retreat_max_s: Positive = 90.0


@dataclass(frozen=True)
class Reporting:
    """Scans on their way up to the MS, the map on its way down [paper 7.4 to 7.6]."""

    store_and_forward: bool = True
    """Deliver later what was scanned while cut off [paper 7.4]. False: discard it, as in [paper 7.2]."""
    resend_min_s: Positive = 1.0
    chunk_cells: Count = 2000
    """Most map changes that one frame carries."""
    window: Count = 32
    """Most reports of a robot that are under way to the MS where bandwidth is limited."""


@dataclass(frozen=True)
class Scouting:
    """Policy scout (docs/scout.md); each rule can be switched off alone."""

    predict: bool = True
    """B: stand rather than walk out of the predicted reach of the NMS. Recruit, wait and stretch need it."""
    shield: bool = True
    """C: stand rather than let a wall come between the robot and a child, and ask the child to yield."""
    hurry: bool = True
    """D: walk at the tracing speed, except for the last metres of a search robot."""
    hurry_beyond_m: NotNegative = 10.0
    recruit: bool = True
    """Replace the own target by that of a deeper robot in need."""
    wait: bool = True
    """A robot in need has longer stall limits while help may come."""
    stretch: bool = True
    """Let the links of a chain in need be longer."""
    need_max_ticks: Ticks = 70
    need_ticks: Ticks = 50
    """A robot that was stopped for this long is in need."""
    need_decay_ticks: Ticks = 5
    recall_s: NotNegative = 10.0
    """A robot recruits for this long after its need has ended."""
    deeper_m: NotNegative = 2.0
    wait_move_s: Positive = 90.0
    wait_path_s: Positive = 270.0
    stretch_share: Positive = 0.95
    """r_in' / r_t while stretched."""
    relax_share: Positive = 0.6
    """Stretching ends when d_in falls below this share of r_in."""
    wall_loss_db: NotNegative | None = None
    """Loss per wall that the robots believe in; None: that of `[radio]`."""

    def wall_factor(self, model: str, wall_loss_db: float, exponent: float) -> float:
        """Factor by which one wall makes a node seem farther away, as the robots believe.

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
        factor: float = 10.0 ** min(loss_db / (10.0 * exponent), MOST_DECADES)
        return factor


@dataclass(frozen=True)
class Sorties:
    """Policy sortie (docs/sortie.md); each rule can be switched off alone."""

    leave: bool = True
    """Sortie: who is stopped near its frontier leaves the network for a while."""
    stopped_ticks: Count = 15
    """B stopped the robot for this long."""
    budget_s: Positive = 40.0
    """How long a sortie takes at most."""
    budget_doublings: Annotated[int, Ge(0), Le(10)] = 3
    """The budget doubles with every stall in a row, up to so often."""
    pace_m_s: Positive = 0.4
    """Mean speed that a robot reckons with, out and home."""
    outward_share: Share = 0.4
    """Share of the budget that the way to the first frontier may take."""
    home_m: Positive = 0.6
    """A robot this near to where it left is home."""
    rest_s: NotNegative = 5.0
    """Shortest time between two sorties."""
    overdue_s: NotNegative = 60.0
    """A robot that is not home this long after its time looks for the network by path recovery."""
    join: bool = True
    """Who is in need goes over to a neighbor that is nearer to its target."""
    join_better_m: NotNegative = 2.0
    join_most_s: Positive = 90.0
    join_pause_s: NotNegative = 20.0
    back: bool = True
    """Whose way leads through deeper places than both its ends goes back up its chain."""
    back_m: NotNegative = 5.0
    """By how much deeper."""
    depth: bool = True
    """Who stalled in need takes shallower frontiers for a while."""
    depth_m: NotNegative = 3.0
    depth_s: NotNegative = 120.0


@dataclass(frozen=True)
class GivingWay:
    """Robots that are in one another's way (docs/bodies.md); only with bodies. Each rule can be switched off alone."""

    avoid: bool = True
    """Choose velocities that do not lead into neighbors, make room, and back off."""
    horizon_s: Positive = 2.0
    """Contacts later than this do not count."""
    weight_m: NotNegative = 0.3
    """What a contact costs: this over the time to it."""
    margin_m: NotNegative = 0.05
    """Distance to others beyond contact."""
    room_m: NotNegative = 0.3
    """Who wants to stand keeps that far from others."""
    held_ticks: Count = 10
    back_s: NotNegative = 1.5
    """Who was held up so long by a robot with right of way walks back for this long."""
    go_round: bool = True
    """Plan around bodies that nobody speaks for."""
    bump_ticks: Count = 5
    """A robot that is held up for so long, by no wall and no neighbor, has met such a body."""
    remember_s: NotNegative = 120.0
    clear_doors: bool = True
    """A relay that waits in a narrow place steps on."""
    door_width_m: Positive = 1.5
    step_on_m: Positive = 2.0
    stay_s: NotNegative = 5.0


@dataclass(frozen=True)
class Rules:
    """All rules of a robot's behavior."""

    routing: Routing = field(default_factory=Routing)
    classing: Classing = field(default_factory=Classing)
    moving: Moving = field(default_factory=Moving)
    exploring: Exploring = field(default_factory=Exploring)
    reporting: Reporting = field(default_factory=Reporting)
    scouting: Scouting = field(default_factory=Scouting)
    sorties: Sorties = field(default_factory=Sorties)
    giving_way: GivingWay = field(default_factory=GivingWay)

    def check(self) -> None:
        """Check the rules that concern several fields.

        Raises:
            ValueError: one line that says what is wrong, with keys relative to `[rules]`.
        """
        routing, exploring = self.routing, self.exploring
        if not routing.r_in_share < routing.r_out_share <= 1:
            shares = f"r_in_share = {routing.r_in_share:g}, r_out_share = {routing.r_out_share:g}"
            raise ValueError(f"routing: {shares}: needs r_in_share < r_out_share <= 1")
        if exploring.retreat_min_s > exploring.retreat_max_s:
            raise ValueError("exploring: needs retreat_min_s <= retreat_max_s")


@dataclass(frozen=True)
class RobotConfig:
    """One robot, or the DSDV node of the MS, which does not move."""

    node: int
    """Its id."""
    seed: int
    """Of the run; what a robot draws comes from it alone (`world/seeds.py`)."""
    geometry: GridGeometry
    """The grid that all maps of the run share, in global coordinates [paper 2.2]."""
    station_m: tuple[float, float]
    """Where the MS is."""
    safety_zone_m: tuple[float, float, float, float]
    """x0, y0, x1, y1: known free from the start."""
    radius_m: float
    """r_t."""
    lidar_range_m: float
    """What a beam says that hits nothing."""
    lidar_beams: int
    """Ranges of a scan."""
    tx_power_dbm: float
    """With which every node sends."""
    loss_1m_db: float
    """Path loss over the first metre."""
    exponent: float
    """Path-loss exponent of the curve that turns received power into distance [paper 5.4]."""
    robots: int = MAX_NODE
    """N: robots are 1..N, and whoever is named beyond does not exist."""
    lidar_noise_m: float = 0.0
    """Standard deviation of a range, as the lidar's maker states it."""
    pose_noise_m: float = 0.0
    """Standard deviation of each coordinate of the own pose."""
    power_smoothing_s: float = 0.0
    """Time constant of the smoothing of received power; 0 = no smoothing."""
    wall_factor: Annotated[float, Ge(1)] = 1.0
    """Factor by which a wall in between makes a neighbor seem farther away: 1 = no difference, inf = it blocks."""
    body_radius_m: NotNegative = 0.0
    """Of the disc that this robot is, like all others; 0 = a point."""
    bandwidth_limited: bool = False
    """Whether the radio may take less than the robot has to say; its inbox tells how much (medium/airtime.py)."""
    policy: str = "vds"
    """Who decides: vds, scout, sortie, or module:Class (agents/policies.py)."""
    rules: Rules = field(default_factory=Rules)
    """Parameters of the rules: `[rules]` of the scenario."""
