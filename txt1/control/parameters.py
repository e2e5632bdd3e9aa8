"""The safety gate's parameters, a section of the configuration.

They stay uncompiled: the configuration's constraints and descriptions are read from the source.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Le

from txt1.model.vehicle import PWM_MAX, Geometry
from txt1.units import NotNegative, Positive, PositiveInt

SpeedMap = tuple[tuple[float, float], ...]
"""Motor counts and the steady speed they make, m/s: both rise from the slowest that moves it; reverse is below 0."""


@dataclass(frozen=True, slots=True)
class Safety:
    """Limits of the safety gate, and the conditions under which it closes."""

    v_max: Annotated[float, Gt(0.0), Le(10.0)] = 1.5
    """Largest absolute speed, m/s; the TXT-1's is 1.5 (thesis 4.2)."""
    omega_max: Positive = 6.0
    """Largest absolute yaw rate, rad/s; for a car that steers the turning radius limits it earlier."""
    v_dead_band: NotNegative = 0.0
    """A slower set-point counts as 0, m/s."""
    motor_max: Annotated[int, Gt(0), Le(PWM_MAX)] = 8000
    """Largest absolute motor output, PWM counts."""
    command_timeout: Annotated[float, Gt(0.0), Le(2.0)] = 0.25
    """Age at which a command is stale, s."""
    runaway_motor: Annotated[int, Gt(0), Le(PWM_MAX)] = 2000
    """Motor output above which a silent encoder means a runaway, PWM counts."""
    runaway_time: Positive = 0.3
    """How long an encoder may be silent above this output, s."""
    runaway_counts: PositiveInt = 150
    """Encoder counts of one wheel during which the other may be silent."""
    runaway_speed: Positive = 2.0
    """Measured speed that means a runaway of the controller, m/s."""
    missed_ticks_max: PositiveInt = 5
    """Number of controller cycles missed in a row that disarms."""
    battery_good: Positive = 9.5
    """Voltage of the better pack above which it is good, V; for three lithium cells (thesis 3.6)."""
    battery_bad: Positive = 9.0
    """Voltage at and below which it is bad, V; the robot disarms after 5 s of it."""
    auto_arm: Literal["auto", "always", "never"] = "auto"
    """Whether the robot arms when it starts: "auto" does in simulation only."""


@dataclass(frozen=True, slots=True)
class KnownCar:
    """The velocity loops' knowledge of the car, besides the thesis's PID controllers, if the loops run here."""

    known: bool = False
    """Whether they use it: true encoder geometry in turns, feed-forward of motor and steering; for cars that steer."""
    speed_gain: Positive = 0.00033
    """Free speed per PWM count beyond the dead band, m/s."""
    dead_band: NotNegative = 300.0
    """Counts around neutral at which the motors coast."""
    time_constant: Positive = 0.3
    """Time constant of the driven speed, s."""
    scrub: NotNegative = 0.06
    """Share of the free speed that full lock costs."""
    acceleration: Positive = 3.0
    """Acceleration of the speed's reference to its set-point, m/s^2; chosen, a third of what tyres hold."""


@dataclass(frozen=True, slots=True)
class Limits(Safety):
    """The safety gate's limits for a vehicle that turns no sharper than `radius_min` (m); 0: it turns in place."""

    radius_min: float = Geometry().radius_min
