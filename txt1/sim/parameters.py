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
    """Time constant of the driven speed, s; assumed."""
    coast_time_constant: Positive = 0.6
    """Time constant of the viscous part of coasting, s; assumed."""
    coast_friction: Positive = 0.1
    """Dry part of coasting, as a speed in m/s: it decelerates by (v + friction) / time constant; assumed."""
    servo_rate: Positive = (pi / 3.0) / 0.15
    """Rate of the steering servos, rad/s: 60 degrees in 0.15 s; assumed."""
    scrub: Share = 0.06
    """Share of the free speed that full lock costs; assumed."""
    slip: Share = 0.0
    """Share by which driven wheels turn more than the ground passes; 0 is no slip."""
    understeer: NotNegative = 0.0
    """Widens curves: curvature is divided by 1 + understeer v^2, s^2/m^2; 0 is none."""
    grip: Annotated[float, Gt(0.0), Le(2.0)] = 1.0489
    """Largest acceleration that tyres hold in any direction, in g; as in the public F1TENTH simulator, 1:10."""
    cornering: Annotated[float, Ge(2.5)] = 5.72
    """Sideways force of a tyre, as a share of its load, per slip angle, 1/rad: 1.0489 * 5.4562, from the same
    simulator.
    """
    inertia: Annotated[float, Ge(0.01), Le(0.9)] = 0.23
    """Share of the car's inertia that turns: 0.95 kg of wheels and 1.5 kg of rotors, as if at the tyres' rims, beside a
    mass of 8 kg (docs/physics.md).
    """
    stiffness: Annotated[float, Ge(2.5)] = 22.3
    """Force of a tyre along, as a share of its load, per slip, before it slides: as of the tyre of
    commonroad-vehicle-models (p_kx1).
    """
    skid: Positive = 1.0
    """Factor by which sides at two speeds turn it as if it were wider, as tyres scrub sideways; 1: not wider."""
    voltage: NotNegative = INTERCEPT_V
    """Voltage of a pack for which `speed_gain` holds, V: a full pack under load (thesis 3.6.3).

    The free speed is proportional to the voltage; 0: it is constant.
    """


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of the simulation's random values; 0 switches a value off."""

    drag: Annotated[float, Ge(0.0), Le(0.2)] = 0.03
    """Noise of the floor's drag, as a share of the speed, drawn every 20 ms; assumed."""
    battery: NotNegative = 0.01
    """Noise of a voltage reading, V; assumed."""


@dataclass(frozen=True, slots=True)
class Faults:
    """Broken parts of the simulated vehicle."""

    right_encoder: bool = False
    """The right encoder's counter stands still."""
    left_encoder: bool = False
    """The left encoder's counter stands still."""
    voltage: NotNegative | None = None
    """Reading of each connected pack, V; null: by its charge."""


@dataclass(frozen=True, slots=True)
class Batteries:
    """The simulated batteries and their load, as a share of the thesis's full load."""

    used_1: NotNegative | None = 0.0
    """Minutes under full load that pack 1 has given; null: not connected."""
    used_2: NotNegative | None = None
    """Minutes under full load that pack 2 has given; null: not connected."""
    external: Positive | None = None
    """Voltage of the external supply, V, whose diode leads while no pack is higher; null: none, but without packs."""
    idle_load: Share = 0.4
    """Current with the motors off, as a share of the full load; assumed."""
    standby_load: Share = 0.1
    """Current with the ATX supply off as well; assumed."""
    by_speed: bool = False
    """Whether the load depends on speed, turning and floor; false: driving draws full load, as at 0.5 m/s in
    the thesis.
    """
    still: Share = 0.2
    """Share of the load at 0.5 m/s that does not depend on the speed: the motors' heat; assumed."""
    drag: Share = 0.3
    """Share of the load at 0.5 m/s that grows with the square of the speed; the rest grows with the speed; assumed."""
    turning: NotNegative = 0.3
    """Share by which the load is larger at full lock, by the square of the curvature; assumed."""
    floor: Positive = 1.0
    """Load on this floor relative to the thesis's floor; on a carpet 1.5 to 2; assumed."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle on the floor of the simulated room: an obstacle, or a vehicle's body."""

    x: float
    """x of its centre, m."""
    y: float
    """y of its centre, m."""
    length: Positive
    """Length along its own x axis, m."""
    width: Positive
    """Width along its own y axis, m."""
    theta: float = 0.0
    """Heading of its x axis, rad."""
    kind: Literal["box"] = "box"
    """Distinguishes it from a post."""


@dataclass(frozen=True, slots=True)
class Post:
    """A round post on the floor of the simulated room."""

    x: float
    """x of its centre, m."""
    y: float
    """y of its centre, m."""
    radius: Positive
    """Radius of the post, m."""
    kind: Literal["post"] = "post"
    """Distinguishes it from a box."""


@dataclass(frozen=True, slots=True)
class Mover:
    """A box that moves along a path on the floor of the simulated room and never stops; it points along its path."""

    path: Annotated[tuple[tuple[float, float], ...], MinLen(2)]
    """Points x, y of its centre, m; it starts at the first."""
    speed: Positive
    """Speed along the path, m/s."""
    lap: bool = False
    """Whether it goes from the last point to the first, round and round; false: it returns the way it came."""
    length: Positive = 0.4
    """Length of the box, m."""
    width: Positive = 0.4
    """Width of the box, m."""


@dataclass(frozen=True, slots=True)
class Roughness:
    """The ground: waves of random lengths and directions; all assumed."""

    height: NotNegative = 0.0
    """Root mean square of the height, m; 0 is flat."""
    shortest: Positive = 0.4
    """Shortest wave, m; the car bridges shorter waves."""
    longest: Positive = 3.0
    """Longest wave, m."""


@dataclass(frozen=True, slots=True)
class LineFaults:
    """The faults of a line, in both directions; none by default.

    A piece is the data of a write or a read: a frame.
    """

    drop: Share = 0.0
    """Share of the pieces that are lost."""
    tear: Share = 0.0
    """Share of the pieces that lose their end."""
    flip: Share = 0.0
    """Probability of each bit to arrive inverted."""
    duplicate: Share = 0.0
    """Share of the pieces that arrive twice."""
    split: bool = False
    """Every byte arrives as a piece of its own."""
    merge: NotNegative = 0.0
    """Pieces are delivered at this interval, s, all pieces since the last delivery as a single piece."""
    delay: NotNegative = 0.0
    """Delay of every piece, s."""
    jitter: NotNegative = 0.0
    """Largest further random delay of a piece, s; the order is kept."""
    stall: NotNegative = 0.0
    """Duration of a stall, in which the line delivers nothing, s."""
    stall_every: Positive = 10.0
    """Mean time between two stalls, s."""
    cut: NotNegative = 0.0
    """Time after which the line is lost, s; 0: never."""

    @property
    def harmless(self) -> bool:
        """Return whether the line has no fault."""
        return not any(astuple(replace(self, stall_every=0.0)))
