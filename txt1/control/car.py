"""Velocity loops that know the car: the encoders' true geometry, and feed-forward of motor and steering.

They are an alternative to the thesis's loops (thesis 4), and include the thesis's PID controllers. They compute with
plain numbers, as numba compiles them.
"""

from math import atan, copysign, sqrt
from typing import NamedTuple

from txt1.control.parameters import KnownCar
from txt1.control.pid import CLEAR, Gains, Past, errors, pid
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry


class CarParameters(NamedTuple):
    """The loops' knowledge of the car, as plain numbers; see `KnownCar` and `Geometry`."""

    lever: float
    # wheelbase of steered encoder wheels, m; 0 if they are not steered
    encoders: float
    tan_steering_max: float
    steering_max: float
    speed_gain: float
    dead_band: float
    time_constant: float
    scrub: float
    acceleration: float


def car_of(known: KnownCar, body: Geometry) -> CarParameters | None:
    """Return the loops' knowledge of the car; None: no knowledge, as always for sides at two speeds."""
    if not known.known or body.steering == "skid":
        return None
    # the encoders of a car with front steering sit at its rear wheels
    steered = body.steering == "both"
    return CarParameters(
        body.lever,
        body.wheelbase if steered else 0.0,
        body.tan_steering_max,
        body.steering_max,
        known.speed_gain,
        known.dead_band,
        known.time_constant,
        known.scrub,
        known.acceleration,
    )


def true_velocity(v: float, omega: float, wheelbase: float) -> tuple[float, float]:
    """Return speed and yaw rate of the car's centre, m/s and rad/s, from the readings of its steered front wheels.

    With both axles steered by phi, the front wheels roll 1 / cos(phi) times the centre's path. Their difference is only
    cos(phi) of the turn by (2.24). With tan(phi) = curvature L / 2, the curvature that they show is curvature / (1 +
    (curvature L / 2)^2). This is solved here for the curvature. Wheels that do not steer have wheelbase 0 here, and
    their readings are true.
    """
    if v == 0.0:
        return v, omega
    # no steering makes more, but noise does
    told = min(max(omega / v * wheelbase, -1.0), 1.0)
    tangent = told / (1.0 + sqrt(1.0 - told * told))
    cos_phi = 1.0 / sqrt(1.0 + tangent * tangent)
    return v * cos_phi, omega / cos_phi


def informed_step(
    linear: Past,
    angular: Past,
    lead: float,
    v: float,
    omega: float,
    v_now: float,
    omega_now: float,
    linear_gains: tuple[float, float, float],
    angular_gains: tuple[float, float, float],
    dt: float,
    car: CarParameters,
) -> tuple[Past, Past, float, float, float]:
    """Return both loops' next states, the reference speed of the next cycle, and motor and steering output, counts.

    The reference moves to the set-point v at the car's acceleration; `lead` is its last value. The motor gets its
    feed-forward, tau dv/dt + (1 + scrub) v, and the steering the angle of the curvature omega / v. The PID controllers
    get the remaining error against the last cycle's reference, as the encoders show that cycle's motion.
    """
    lever, encoders, tan_max, steering_max, speed_gain, dead_band, time_constant, scrub, acceleration = car
    most = acceleration * dt
    step = min(max(v - lead, -most), most)
    reference = lead + step
    curvature = omega / v if v != 0.0 else 0.0
    tangent = min(max(curvature * lever, -tan_max), tan_max)
    drive = reference * (1.0 + scrub * (tangent / tan_max) ** 2) + time_constant * step / dt
    motor = copysign(dead_band, drive) + drive / speed_gain if drive != 0.0 else 0.0
    steering = STEERING_MAX * atan(tangent) / steering_max
    v_true, omega_true = true_velocity(v_now, omega_now, encoders)
    error, yaw_error = errors(lead, curvature * lead, v_true, omega_true)
    linear = pid(linear, error, linear_gains, dt, float(PWM_MAX))
    angular = pid(angular, yaw_error, angular_gains, dt, float(STEERING_MAX))
    return linear, angular, reference, motor + linear[0], steering + angular[0]


class InformedLoops:
    """The two loops of a known car; the same interface as `txt1.control.pid.VelocityLoops`."""

    def __init__(self, car: CarParameters) -> None:
        self._car = car
        self.clear()

    def clear(self) -> None:
        """Forget the past."""
        self._linear = self._angular = CLEAR
        self._lead = 0.0
        self._outputs = [0.0, 0.0]

    def step(
        self, v: float, omega: float, v_now: float, omega_now: float, linear: Gains, angular: Gains, dt: float
    ) -> tuple[float, float]:
        """Motor and steering output, counts; see `txt1.control.pid.VelocityLoops.step`."""
        if dt > 0.0:
            self._linear, self._angular, self._lead, *self._outputs = informed_step(
                self._linear, self._angular, self._lead, v, omega, v_now, omega_now, linear, angular, dt, self._car
            )
        motor, steering = self._outputs
        return motor, steering
