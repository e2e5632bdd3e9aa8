"""The parameters of the simulated vehicle; each class is a section of the configuration.

They stay uncompiled: the configuration's constraints and descriptions are read from the source.
"""

from dataclasses import astuple, dataclass, replace
from math import pi
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MinLen

from txt1.model.battery import INTERCEPT_V
from txt1.units import NotNegative, Positive, Share


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """The simulated vehicle's dynamics."""

    speed_gain: Positive = 0.00033
    """Free speed per PWM count beyond the dead band, m/s; assumed."""
    dead_band: NotNegative = 300.0
    """Counts around neutral at which the motors coast; assumed."""
    speed_time_constant: Positive = 0.3
    """Of the driven speed response, s; assumed."""
    coast_time_constant: Positive = 0.6
    """Of the viscous part of rolling to a stop, s; assumed."""
    coast_friction: Positive = 0.1
    """Of the dry part, as a speed in m/s: coasting decelerates by (v + friction) / time constant; assumed."""
    servo_rate: Positive = (pi / 3.0) / 0.15
    """Of the steering servos, rad/s: 60 degrees in 0.15 s; assumed."""
    scrub: Share = 0.06
    """Share of the free speed that full lock costs; assumed."""
    slip: Share = 0.0
    """Share by which driven wheels turn more than the ground passes; 0 is no slip."""
    understeer: NotNegative = 0.0
    """Widens curves: curvature is divided by 1 + understeer v^2, s^2/m^2; 0 is none."""
    grip: Annotated[float, Gt(0.0), Le(2.0)] = 1.0489
    """Most that tyres hold in any direction, as a share of their load: as the public F1TENTH simulator's, 1:10."""
    cornering: Annotated[float, Ge(2.5)] = 5.72
    """Force of a tyre sideways, as a share of its load, per slip angle, 1/rad: 1.0489 * 5.4562, from there, too."""
    skid: Positive = 1.0
    """Factor by which sides at two speeds turn it as if it were wider: tyres that scrub sideways; 1 is none."""
    voltage: NotNegative = INTERCEPT_V
    """Of a pack with which `speed_gain` holds, V: a full one under load (thesis 3.6.3). The free speed goes with the
    voltage; 0: it does not."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of the simulation's random values; 0 switches one off."""

    drag: Annotated[float, Ge(0.0), Le(0.2)] = 0.03
    """Of the floor's drag, as a share of the speed, drawn anew every 20 ms; assumed."""
    battery: NotNegative = 0.01
    """Of a voltage reading, V; assumed."""


@dataclass(frozen=True, slots=True)
class Faults:
    """Broken parts of the simulated vehicle."""

    right_encoder: bool = False
    """The right encoder's counter stands still."""
    left_encoder: bool = False
    """The left encoder's counter stands still."""
    voltage: NotNegative | None = None
    """Each pack that is fitted reads so many volts; null: as charged."""


@dataclass(frozen=True, slots=True)
class Batteries:
    """The simulated batteries and their load: a share of the full load under which the thesis measured."""

    used_1: NotNegative | None = 0.0
    """Minutes under full load that pack 1 has given; null when none is fitted."""
    used_2: NotNegative | None = None
    """The same of pack 2."""
    idle_load: Share = 0.4
    """Current with the motors off, as a share of the full load; assumed."""
    standby_load: Share = 0.1
    """Current with the ATX supply off as well; assumed."""
    by_speed: bool = False
    """Whether driving draws by speed, turning and floor; false: full load, as the thesis measured it at 0.5 m/s."""
    still: Share = 0.2
    """Of what driving draws at 0.5 m/s, the share that it draws however slow it is: the motors' heat; assumed."""
    drag: Share = 0.3
    """Likewise the share that grows with the square of the speed; the rest grows with the speed; assumed."""
    turning: NotNegative = 0.3
    """Share by which driving draws more at full lock, by the square of the curvature; assumed."""
    floor: Positive = 1.0
    """What driving draws here beside the thesis's floor; a carpet 1.5 to 2; assumed."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle on the floor of the simulated room: an obstacle, or a vehicle's body."""

    x: float
    """Of its centre, m."""
    y: float
    """Of its centre, m."""
    length: Positive
    """Along its own x axis, m."""
    width: Positive
    """Along its own y axis, m."""
    theta: float = 0.0
    """Heading of its x axis, rad."""
    kind: Literal["box"] = "box"
    """Tells it from a post."""


@dataclass(frozen=True, slots=True)
class Post:
    """A round post on the floor of the simulated room."""

    x: float
    """Of its centre, m."""
    y: float
    """Of its centre, m."""
    radius: Positive
    """Of the post, m."""
    kind: Literal["post"] = "post"
    """Tells it from a box."""


@dataclass(frozen=True, slots=True)
class Mover:
    """A box that moves along a path on the floor of the simulated room, whoever is in its way; ahead is its length."""

    path: Annotated[tuple[tuple[float, float], ...], MinLen(2)]
    """Points x, y of its centre, m; it begins at the first one."""
    speed: Positive
    """Along the path, m/s."""
    lap: bool = False
    """From the last point it goes on to the first, round and round; false: it goes back the way it came."""
    length: Positive = 0.4
    """Of the box, m."""
    width: Positive = 0.4
    """Of the box, m."""


@dataclass(frozen=True, slots=True)
class Roughness:
    """The ground: waves of random lengths and directions; all assumed."""

    height: NotNegative = 0.0
    """Root mean square of the height, m; 0 is flat."""
    shortest: Positive = 0.4
    """Of the waves, m; the car bridges shorter ones."""
    longest: Positive = 3.0
    """Of the waves, m."""


@dataclass(frozen=True, slots=True)
class LineFaults:
    """The faults of a line, both ways; none by default. A piece is what one write or one read brought: a frame."""

    drop: Share = 0.0
    """Share of the pieces that are lost."""
    tear: Share = 0.0
    """Share of the pieces of which the end is lost."""
    flip: Share = 0.0
    """Probability of each bit to arrive inverted."""
    duplicate: Share = 0.0
    """Share of the pieces that come twice."""
    split: bool = False
    """Every byte arrives as a piece of its own."""
    merge: NotNegative = 0.0
    """Pieces are handed on so many seconds apart, all that has come since then as one."""
    delay: NotNegative = 0.0
    """Every piece arrives so much later, s."""
    jitter: NotNegative = 0.0
    """Each piece arrives up to that much later still, s; the order is kept."""
    stall: NotNegative = 0.0
    """How long the line holds everything back each time, s."""
    stall_every: Positive = 10.0
    """Mean time between two stalls, s."""
    cut: NotNegative = 0.0
    """Time after which the line is lost, s; 0: never."""

    @property
    def harmless(self) -> bool:
        """Whether nothing at all is wrong."""
        return not any(astuple(replace(self, stall_every=0.0)))
