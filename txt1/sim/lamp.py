"""A point light and the four sensors that see it (thesis 3.7, 5.3, 5.4). No clock: a call is a sample."""

from collections.abc import Callable, Sequence
from functools import cache
from math import cos, erf, exp, pi, sin, sqrt, tan
from typing import Final, NamedTuple

from mypy_extensions import mypyc_attr

from txt1.model.light_sensors import (
    EVEN,
    LUX_MAX,
    LUX_MIN,
    MOUNT,
    SENSOR_X,
    SENSOR_Y,
    SENSORS,
    SOUND,
    Gains,
    Mount,
    Readings,
    SensorFault,
)
from txt1.sim.pcg64 import Draws

# square of the lamp's radius, m^2: at smaller distances the light does not grow
NEAREST: Final = 0.03**2


Lit = Callable[[float, float, float], Sequence[bool]]
"""For a pose, m and rad: whether FL, FR, RL and RR see the light."""


class PointLight(NamedTuple):
    """A light that is equally bright in all directions.

    The default is the thesis's 100 W lamp: 1700 lm over the whole sphere are 135 lux at 1 m. So the sensors' three
    decades reach from 0.37 m, which is the last decimetre before the goal circle, to 11.6 m, which is farther than
    any corner of the walls at +-8 m: inside them no healthy sensor falls silent.
    """

    # m, in the room
    x: float = 0.0
    # m, in the room
    y: float = 0.0
    # lux at a distance of 1 m
    intensity: float = 135.0
    # the light falls as 1 / d^exponent: 2 by the thesis's words, 4 by its (5.9)
    exponent: float = 2.0
    # height above the sensors' plane, m
    height: float = 0.0


class Range(NamedTuple):
    """The readings a sensor can give, lux; values outside read as the nearer end."""

    low: float = LUX_MIN
    high: float = LUX_MAX


# 1 to 1000 lux (thesis 5.3)
SENSOR_LIMITS: Final = Range()


def illuminances(x: float, y: float, theta: float, light: PointLight) -> Readings:
    """Return the light on each of the four sensors, lux, without noise or limits, for a pose (x, y, theta); m
    and rad.
    """
    return Readings(*lux_at(x, y, theta, light))


def lux_at(
    x: float, y: float, theta: float, light: PointLight, mount: Mount = MOUNT
) -> tuple[float, float, float, float]:
    """Return the same as plain numbers, in the order of the sensors, which are at `mount`."""
    c, s = cos(theta), sin(theta)
    light_x, light_y, intensity, exponent, height = light
    dx, dy = light_x - x, light_y - y
    # the light in the vehicle's frame
    ahead = c * dx + s * dy
    left = c * dy - s * dx
    (fl_x, fl_y), (fr_x, fr_y), (rl_x, rl_y), (rr_x, rr_y) = mount
    # I = I(1 m) / d^n, from the squares of the distances
    fl = (ahead - fl_x) * (ahead - fl_x) + (left - fl_y) * (left - fl_y)
    fr = (ahead - fr_x) * (ahead - fr_x) + (left - fr_y) * (left - fr_y)
    rl = (ahead - rl_x) * (ahead - rl_x) + (left - rl_y) * (left - rl_y)
    rr = (ahead - rr_x) * (ahead - rr_x) + (left - rr_y) * (left - rr_y)
    if height:
        up = height * height
        fl, fr, rl, rr = fl + up, fr + up, rl + up, rr + up
    if fl < NEAREST or fr < NEAREST or rl < NEAREST or rr < NEAREST:
        fl, fr, rl, rr = max(fl, NEAREST), max(fr, NEAREST), max(rl, NEAREST), max(rr, NEAREST)
    if exponent != 2.0:
        half = 0.5 * exponent
        fl, fr, rl, rr = fl**half, fr**half, rl**half, rr**half
    return intensity / fl, intensity / fr, intensity / rl, intensity / rr


@cache
def noise_for_jitter(
    jitter: float = pi / 4.0,
    share: float = 0.95,
    distance: float = 1.25,
    exponent: float = 2.0,
    height: float = 0.0,
) -> float:
    """Return the standard deviation sigma of a reading's noise, as a share of it, for a given jitter of the direction.

    The thesis saw the unfiltered direction oscillate by +-45 degrees (5.5.2). Here that is an interval which holds
    `share` of the samples when the robot faces the light at the distance where episodes begin.

    By symmetry both front sensors then see the light F, and both rear sensors B. With readings I_i = (1 + sigma z_i)
    times these, z_i standard normal, the summed components X = a (FL + FR - RL - RR) and Y = b (FL + RL - FR - RR),
    where a and b are the sensors' offsets, are normal too:

        E X = 2 a (F - B)      sd X = a sigma sqrt(2 F^2 + 2 B^2)
        E Y = 0                sd Y = b sigma sqrt(2 F^2 + 2 B^2)

    and independent: their covariance a b sigma^2 (F^2 - F^2 - B^2 + B^2) is 0. The direction atan2(Y, X) is within
    +-jitter when abs(Y) <= X tan(jitter), so

        share = integral over X > 0 of  phi((X - E X) / sd X) / sd X  erf(X tan(jitter) / (sqrt(2) sd Y))  dX

    which falls as sigma grows; bisection finds sigma: 0.302 for the default. Only the ratio of F to B enters, not the
    light's intensity. The simple estimate 1.96 sd Y = E X would give twice the value: it forgets that X is noisier
    than Y. At 0.302 hardly a reading would fall below 0, where a sensor's range ends; with the 0.484 for exponent 4
    one in fifty would, which leaves 96 % of the directions inside.

    Args:
        jitter: half the interval, rad, below pi/2.
        share: share of the samples inside the interval.
        distance: distance of the light from the robot's centre, m.
        exponent: exponent of the light's fall.
        height: height of the light above the sensors' plane, m.

    Raises ValueError: no noise gives this jitter.
    """
    facing = illuminances(-distance, 0.0, 0.0, PointLight(exponent=exponent, height=height))
    front, rear = facing.front_left, facing.rear_left
    mean = 2.0 * SENSOR_X * (front - rear)
    per_sigma = sqrt(2.0 * front * front + 2.0 * rear * rear)
    if not (0.0 < jitter < pi / 2.0 and mean > 0.0):
        raise ValueError(f"no jitter of +-{jitter:g} rad can be had with the light {distance:g} m ahead")

    def inside(sigma: float) -> float:
        sd_x, sd_y = SENSOR_X * sigma * per_sigma, SENSOR_Y * sigma * per_sigma
        lowest, highest = max(0.0, mean - 8.0 * sd_x), mean + 8.0 * sd_x
        step = (highest - lowest) / 400
        total = 0.0
        # midpoint rule
        for k in range(400):
            x = lowest + (k + 0.5) * step
            density = exp(-0.5 * ((x - mean) / sd_x) ** 2) / (sd_x * sqrt(2.0 * pi))
            total += density * erf(x * tan(jitter) / (sqrt(2.0) * sd_y))
        return total * step

    low, high = 1e-6, 10.0
    if not inside(high) < share < inside(low):
        raise ValueError(f"no noise keeps {share:.2%} of the directions within +-{jitter:g} rad")
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        if inside(middle) > share:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@mypyc_attr(allow_interpreted_subclasses=True)
class LightSensors:
    """The four sensors of a vehicle: `read` once every `txt1.model.light_sensors.SAMPLE_PERIOD`.

    Args:
        light: the light.
        noise: standard deviation of each reading's Gaussian noise, as a share of the reading, drawn anew for each
            sensor and sample; 0 switches it off. `noise_for_jitter()` is the thesis's.
        rng: repeats every random value from its seed.
        limits: range of a reading.
        mount: their places on the vehicle.
        gains: factors on the readings: a dirty sensor reads less.
        lit: returns whether each sensor sees the light from a pose, past walls; None: every sensor sees it.

    """

    def __init__(
        self,
        light: PointLight,
        noise: float,
        rng: Draws,
        limits: Range = SENSOR_LIMITS,
        mount: Mount = MOUNT,
        gains: Gains = EVEN,
        lit: Lit | None = None,
    ) -> None:
        self.light = light
        self.mount = mount
        self.gains = gains
        self.lit = lit
        self.noise = noise
        self.limits = limits
        self._rng = rng
        self._draws: list[float] = []
        self._faults: tuple[SensorFault, ...] = SOUND
        self._broken = False
        self._last: Readings | None = None

    @property
    def faults(self) -> tuple[SensorFault, ...]:
        """The faults of the sensors, in the order FL FR RL RR."""
        return self._faults

    @faults.setter
    def faults(self, faults: Sequence[str]) -> None:
        if len(faults) != len(SENSORS):
            raise ValueError(f"one fault for each of {', '.join(SENSORS)} is needed, not {len(faults)}")
        self._faults = tuple(SensorFault(fault) for fault in faults)
        self._broken = self._faults != SOUND

    def read(self, x: float, y: float, theta: float) -> Readings:
        """Return the next sample, lux, of the vehicle at (x, y, theta) in the room; m and rad."""
        low, high = self.limits
        fl, fr, rl, rr = lux_at(x, y, theta, self.light, self.mount)
        if self.lit is not None:
            fl, fr, rl, rr = (lux * seen for lux, seen in zip((fl, fr, rl, rr), self.lit(x, y, theta), strict=True))
        if self.gains != EVEN:
            fl, fr, rl, rr = (gain * lux for gain, lux in zip(self.gains, (fl, fr, rl, rr), strict=True))
        noise = self.noise
        if noise:
            draws = self._draws
            if not draws:
                draws = self._draws = list(map(float, self._rng.standard_normal(64 * len(SENSORS))))
            fl *= 1.0 + noise * draws.pop()
            fr *= 1.0 + noise * draws.pop()
            rl *= 1.0 + noise * draws.pop()
            rr *= 1.0 + noise * draws.pop()
        readings = Readings(
            low if fl < low else high if fl > high else fl,
            low if fr < low else high if fr > high else fr,
            low if rl < low else high if rl > high else rl,
            low if rr < low else high if rr > high else rr,
        )
        if self._broken:
            readings = self._break(readings)
        self._last = readings
        return readings

    def _break(self, readings: Readings) -> Readings:
        """Return the readings with the sensors' faults."""
        last = self._last or readings
        broken = {SensorFault.DEAD: 0.0, SensorFault.NAN: float("nan")}
        return Readings(
            *(
                before if fault is SensorFault.FROZEN else broken.get(fault, now)
                for now, before, fault in zip(readings, last, self._faults, strict=True)
            )
        )
