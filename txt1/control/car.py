"""Velocity loops that know the car: the encoders' true geometry, and motor and steering fed forward.

They stand beside the thesis's (thesis 4), whose PID controllers close them too. Plain numbers, as numba compiles them.
"""

from math import atan, copysign, sqrt
from typing import NamedTuple

from txt1.control.parameters import KnownCar
from txt1.control.pid import CLEAR, Gains, Past, VelocityLoops, errors, pid
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry


class CarParameters(NamedTuple):
    """What the loops know, as plain numbers; see `KnownCar` and `Geometry`."""

    lever: float
    encoders: float  # wheelbase of encoder wheels that are steered, m; 0 where they are not
    tan_steering_max: float
    steering_max: float
    speed_gain: float
    dead_band: float
    time_constant: float
    scrub: float
    acceleration: float


def car_of(known: KnownCar, body: Geometry) -> CarParameters | None:
    """What the loops know of the car; None: nothing, as is all they can know of one whose sides run at two speeds."""
    if not known.known or body.steering == "skid":
        return None
    steered = body.steering == "both"  # encoders of a car whose front wheels steer sit at its rear ones
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
    """Speed and yaw rate of the car's centre, m/s and rad/s, from those that its steered front wheels tell.

    With both axles steered by phi the front wheels roll 1 / cos(phi) times the centre's path, and apart by cos(phi) of
    what (2.24) takes for the turn. tan(phi) = curvature L / 2, so what they tell of the curvature is
    curvature / (1 + (curvature L / 2)^2), which is solved for it. Wheels that do not steer, whose wheelbase
    is 0 here, tell the truth.
    """
    if v == 0.0:
        return v, omega
    told = min(max(omega / v * wheelbase, -1.0), 1.0)  # no steering makes more, but noise does
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
    """Both loops' next states, the reference speed to `lead` the next cycle, and motor and steering output, counts.

    The reference goes to the set-point v at the car's acceleration. The motor gets what the car needs for it,
    tau dv/dt + (1 + scrub) v, the steering the angle of the curvature omega / v, the PID controllers what is left of
    the error to the reference of a cycle ago, which is what the encoders tell of.
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
    """The two loops of a car that they know; as `txt1.control.pid.VelocityLoops`."""

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


def loops_for(known: KnownCar, body: Geometry) -> VelocityLoops | InformedLoops:
    """The loops of a car, known or not."""
    car = car_of(known, body)
    return VelocityLoops(body.steering != "skid") if car is None else InformedLoops(car)
