"""Filter, direction, sector and reward, from four light readings (thesis 5.3, 5.5.2).

Directions are in the vehicle's frame, rad, counter-clockwise positive: 0 straight ahead, pi/2 to the left.

A reading that cannot be believed raises `LightFault`, so that no direction is made of it:

- not a number, infinite or negative: at once (`LightFilter.step`, `direction`)
- dead, at 0 while the others see the light: `direction` at once; `LightFilter.step` within half a second, as soon as
  the filtered readings differ more than at any place of the light (`spread_limit`). The same happens to a sensor that
  sticks at its upper limit while the light is farther away than about 1.4 m
- frozen in between: `LightFilter.step`, when a reading has not changed for a second, and each of the others changed at
  least every other time
"""

from math import atan2, exp, floor, hypot, inf, isfinite, pi, sqrt
from typing import Final

from txt1.errors import LightFault, NoDirection
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, SENSOR_X, SENSOR_Y, SENSORS, Readings

# weight of the past in the filter (5.10)
FILTER_WEIGHT: Final = 0.9

# by index (figure 5.5)
SECTORS: Final = (
    "rear centre",
    "rear right",
    "centre right",
    "front right",
    "front centre",
    "front left",
    "centre left",
    "rear left",
)
# after this many samples the first sample has lost nine tenths of its weight in the filter
SETTLING_SAMPLES: Final = 22
# a sensor's changes are counted over this many samples, about a second
FROZEN_SAMPLES: Final = 63


def direction(readings: Readings) -> float:
    """Direction of the light as the thesis computes it (5.3), rad in (-pi, pi].

    Each reading is a vector from the robot's centre out through its sensor; the direction is that of the vectors' sum.
    With sensors at (+-a, +-b) it compresses the bearing: to first order tan(direction) = (b / a)^2 tan(bearing) = 0.31
    tan(bearing), whatever the light's power of distance.

    Raises LightFault: a reading is not a positive, finite number; NoDirection: the readings are all alike.
    """
    front, left = _differences(readings)
    return atan2(SENSOR_Y * left, SENSOR_X * front)


def corrected_direction(readings: Readings) -> float:
    """Direction of the light without the compression of `direction`, rad in (-pi, pi]; raises as `direction` does.

    It is exact for a light far away; the error is at most 1.1 degrees at 2.5 m, 4.4 at 1.25 m and 23 at 0.5 m.
    """
    front, left = _differences(readings)
    return atan2(left / SENSOR_Y, front / SENSOR_X)


def diagonal_direction(readings: Readings) -> float:
    """Direction of the light as if each sensor sat at 45 degrees, rad in (-pi, pi]; raises as `direction` does."""
    front, left = _differences(readings)
    return atan2(left, front)


def _differences(readings: Readings) -> tuple[float, float]:
    """Front minus rear and left minus right, lux."""
    fl, fr, rl, rr = readings
    if not (0.0 < fl < inf and 0.0 < fr < inf and 0.0 < rl < inf and 0.0 < rr < inf):
        _refuse(readings)
    # over the diagonals, so that equal readings give exactly zero
    one, other = fl - rr, fr - rl
    if one == other == 0.0:
        raise NoDirection(fl)
    return one + other, one - other


def _refuse(readings: Readings) -> None:
    """Raise the fault of the readings; at least one is not positive and finite."""
    for sensor, reading in zip(SENSORS, readings, strict=True):
        if not isfinite(reading):
            raise LightFault(f"light sensor {sensor} reads {reading:g}, which is no reading")
        if reading < 0.0:
            raise LightFault(f"light sensor {sensor} reads {reading:g} lux, which is less than nothing")
    if max(readings) == 0.0:
        raise NoDirection(0.0)
    raise _odd_one_out(readings)


def _odd_one_out(readings: Readings) -> LightFault:
    """Return the fault of the sensor that differs most from the middle of the others."""
    first, second, third, last = sorted(readings)
    odd, what = (first, "dead or covered") if second * third >= first * last else (last, "stuck or dazzled")
    listed = ", ".join(f"{sensor} {reading:.4g}" for sensor, reading in zip(SENSORS, readings, strict=True))
    sensor = SENSORS[readings.index(odd)]
    return LightFault(f"light sensor {sensor} is {what}: no light makes the four differ so much ({listed} lux)")


def spread_limit(exponent: float = 2.0, noise: float = 0.3) -> float:
    """Largest ratio of the brightest filtered reading to the dimmest, for a light at least 0.5 m away.

    At a distance D of sensors r from the centre it is ((D + r) / (D - r))^n. Of the `noise`, a share of a sample, the
    filter leaves sqrt((1 - w) / (1 + w)); four standard deviations of the ratio's logarithm are added for it.
    """
    nearest, r = 0.5, hypot(SENSOR_X, SENSOR_Y)
    filtered = noise * sqrt((1.0 - FILTER_WEIGHT) / (1.0 + FILTER_WEIGHT))
    return float(((nearest + r) / (nearest - r)) ** exponent * exp(4.0 * sqrt(2.0) * filtered))


# `Readings` as plain numbers, which cost less to make
Lux = tuple[float, float, float, float]


class LightFilter:
    """I(t) = w I(t-1) + (1 - w) I'(t) (5.10), and a watch over the four sensors; see the module for its rules.

    A faulty sample leaves the filter as it was. `spread` is the largest believable ratio of two filtered readings.
    """

    __slots__ = ("_changes", "_filtered", "_latest", "_samples", "spread")

    def __init__(self, spread: float | None = None) -> None:
        self.spread = spread_limit() if spread is None else spread
        self.clear()

    def clear(self) -> None:
        """Forget the past: the next sample is the first."""
        self._filtered: Lux = (0.0, 0.0, 0.0, 0.0)
        self._latest: Lux = (0.0, 0.0, 0.0, 0.0)
        self._samples = 0
        self._changes = [0, 0, 0, 0]

    @property
    def readings(self) -> Readings | None:
        """The filtered readings, lux; None before the first sample."""
        return Readings(*self._filtered) if self._samples else None

    @property
    def settled(self) -> bool:
        """Whether there were enough samples: the readings are filtered, and the watch over the sensors is active."""
        return self._samples >= SETTLING_SAMPLES

    def step(self, sample: Readings) -> None:
        """Take in a sample, lux; LightFault: a sensor cannot be believed."""
        fl, fr, rl, rr = sample
        if not (0.0 <= fl < inf and 0.0 <= fr < inf and 0.0 <= rl < inf and 0.0 <= rr < inf):
            _refuse(sample)
        if not self._samples:
            self._filtered = self._latest = fl, fr, rl, rr
            self._samples = 1
            return
        past_fl, past_fr, past_rl, past_rr = self._filtered
        w = FILTER_WEIGHT
        now_fl = w * past_fl + (1.0 - w) * fl
        now_fr = w * past_fr + (1.0 - w) * fr
        now_rl = w * past_rl + (1.0 - w) * rl
        now_rr = w * past_rr + (1.0 - w) * rr
        if self._samples >= SETTLING_SAMPLES:
            brightest = max(max(now_fl, now_fr), max(now_rl, now_rr))
            if brightest > self.spread * min(min(now_fl, now_fr), min(now_rl, now_rr)):
                raise _odd_one_out(Readings(now_fl, now_fr, now_rl, now_rr))
        changes, latest = self._changes, self._latest
        changes[0] += fl != latest[0]
        changes[1] += fr != latest[1]
        changes[2] += rl != latest[2]
        changes[3] += rr != latest[3]
        if self._samples % FROZEN_SAMPLES == 0:
            self._refuse_frozen(sample)
        self._filtered = now_fl, now_fr, now_rl, now_rr
        self._latest = fl, fr, rl, rr
        self._samples += 1

    def _refuse_frozen(self, sample: Readings) -> None:
        """Raise LightFault if a single sensor has frozen while the others change."""
        changes, self._changes = self._changes, [0, 0, 0, 0]
        if changes.count(0) != 1 or sum(count >= FROZEN_SAMPLES // 2 for count in changes) != 3:
            return
        frozen = changes.index(0)
        if LUX_MIN < sample[frozen] < LUX_MAX:
            told = f"light sensor {SENSORS[frozen]} is frozen at {sample[frozen]:.4g} lux while the others change"
            raise LightFault(told)


def sector(angle: float) -> int:
    """Return the sector of a direction in rad, 0 to 7 (figure 5.5).

    Sector 0 is centred on straight behind, 4 on straight ahead, and they count counter-clockwise, 45 degrees each. A
    direction on a boundary belongs to the sector counter-clockwise of it: 22.5 degrees is front left.
    """
    return (floor(angle / (pi / 4.0) + 0.5) + 4) % 8


def reward(before: int, after: int) -> int:
    """Return the reward for going from a sector to the next, (5.6) to (5.8).

    It is 1 if the light stays straight ahead or comes nearer to it, 0 if it stays neither ahead nor behind, else -1.
    """
    s0, s1 = before - 4, after - 4
    if s0 == s1 == 0 or abs(s1) < abs(s0):
        return 1
    return 0 if s1 == s0 and s0 != -4 else -1
