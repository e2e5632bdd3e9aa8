"""The fifth rule: three witnesses of the yaw rate vote, and an absolute position overrules the wheels.

Over `WINDOW` the gyro, the wheels, and a third witness (an absolute heading, else the steering) tell how far the robot
has turned. Two that agree outvote the third: mid-value selection, the common voter of redundant sensors (R. J. Patton,
P. M. Frank, R. N. Clark, *Fault Diagnosis in Dynamic Systems*, Prentice Hall 1989). They agree within what slip,
understeer and unequal tyres explain, as these are the car's model and no fault. A gyro that was outvoted has to agree
more closely to be believed again, as in a curve that much would hide its fault. A late reading is no witness.

The wheels' speed has one better witness, an absolute position. It is always right, by `txt1.estimation.judge`. The way
is that of the most precise sensor alone: from one sensor's position to another's there is no way, only their errors.
"""

from collections import deque
from itertools import pairwise
from math import hypot, sqrt
from typing import Final, NamedTuple

from txt1.estimation.judge import FORGOTTEN
from txt1.estimation.measurement import Measurement
from txt1.model.kinematics import wrap_angle

WINDOW: Final = 0.3  # s
# s that an absolute reading may be old
FRESH: Final = 0.5
# cycles
ENOUGH: Final = 8
# s by which a reading may be late and be a witness of how the car moves now
STALE: Final = 0.1
# s of a piece of a path by positions, at least
LEG: Final = 0.2 * WINDOW - 1e-6
# of a rate that slip and understeer explain
SHARE: Final = 0.3
# rad/s, of noise, of lags, and of what is not straight
YAW: Final = 0.08
# rad/s at 1 m/s, of tyres that differ by 1 %
TYRES: Final = 0.04
# m/s, of noise
SPEED: Final = 0.15


class WitnessValues(NamedTuple):
    """The witnesses' values for a cycle; None without a witness."""

    # s of the run, of its end
    time: float
    # m/s, of the wheels
    v: float
    wheels: float  # rad/s
    # rad/s, without its bias
    gyro: float | None
    steering: float | None  # rad/s


class Place(NamedTuple):
    """An absolute reading."""

    time: float  # s
    x: float  # m
    y: float  # m
    theta: float | None  # rad
    sigma: float  # m
    sigma_theta: float  # rad


class Vote:
    """The witnesses' reports of the last seconds."""

    def __init__(self) -> None:
        self.apart = 0.0
        """By how much a believed gyro has turned the pose otherwise than the wheels lately, rad."""
        self.turn_alike = False
        """Whether gyro and wheels turn alike, but for the slip that is known."""
        # s of the run
        self._compared = 0.0
        self._cycles: deque[WitnessValues] = deque()
        self._places: dict[str, deque[Place]] = {}

    def clear(self) -> None:
        """Forget everything: the robot was carried elsewhere."""
        self.apart = 0.0
        self._cycles.clear()
        self._places.clear()

    def cycle(self, cycle: WitnessValues) -> None:
        """Take in a cycle."""
        cycles, time = self._cycles, cycle.time
        cycles.append(cycle)
        while time - cycles[0].time > WINDOW + FRESH:
            cycles.popleft()

    def place(self, measurement: Measurement) -> None:
        """Take in an absolute reading that was taken in by the filter, one for each piece of the path."""
        time, sensor, _, _, values, sigmas, _ = measurement
        places = self._places.get(sensor)
        if places is None:
            places = self._places[sensor] = deque()
        elif time - places[-1].time < LEG:
            return
        places.append(Place(time, values[0], values[1], values[2] if len(values) > 2 else None, sigmas[0], sigmas[-1]))
        while time - places[0].time > WINDOW:
            places.popleft()

    def compare(self, *, turning: bool) -> None:
        """Note how far gyro and wheels have turned apart since the last time; `turning`: the gyro is believed."""
        since, self._compared = self._compared, self._cycles[-1].time if self._cycles else 0.0
        apart = [each.gyro - each.wheels for each in self._cycles if each.time > since and each.gyro is not None]
        if not turning:
            self.apart = 0.0
        elif apart:
            rate = sum(apart) / len(apart) - self.apart / FORGOTTEN
            self.apart += rate * min(self._compared - since, WINDOW)

    def outvoted(self, slip: float = 0.0) -> tuple[bool, bool]:
        """Whether the gyro is, and whether the wheels are; `slip` is the wheels'."""
        self.turn_alike = False
        if not self._cycles:
            return False, False
        end = self._cycles[-1].time
        begin, seen = end - WINDOW, None
        fresh = [places for places in self._places.values() if end - places[-1].time <= FRESH]
        if fresh:
            places = min(fresh, key=lambda each: each[-1].sigma)
            seen = _seen(places)
            if seen is not None:
                begin, end = places[0].time, places[-1].time
        cycles = [each for each in self._cycles if begin < each[0] <= end]
        if len(cycles) < ENOUGH:
            return False, False
        _, speeds, turns, gyros, steerings = zip(*cycles, strict=True)
        v, wheels, gyro, third = sum(speeds) / len(cycles), sum(turns) / len(cycles), _mean(gyros), _mean(steerings)
        self.turn_alike = gyro is not None and abs(gyro - (1.0 - slip) * wheels) <= YAW + TYRES * abs(v)
        noise, sliding = YAW, False
        if seen is not None:
            speed, sigma, turning, uncertain = seen
            v_share = SHARE * max(speed, abs(v))
            sliding = abs(speed - abs(v)) > SPEED + v_share + 4.0 * sigma
            if turning is not None:
                third, noise = turning, YAW + 4.0 * uncertain
        if gyro is None or third is None or _agree(gyro, wheels, v, YAW):
            return False, sliding
        gyro_agrees, wheels_agree = _agree(gyro, third, v, noise), _agree(wheels, third, v, noise)
        return wheels_agree and not gyro_agrees, sliding or (gyro_agrees and not wheels_agree)


def _seen(told: deque[Place]) -> tuple[float, float, float | None, float] | None:
    """Speed (m/s) and its sigma, yaw rate (rad/s; None) and its sigma, by a sensor's absolute readings."""
    first, last = told[0], told[-1]
    span = last.time - first.time
    if span < 0.5 * WINDOW:
        return None
    path, turned = 0.0, 0.0 if first.theta is not None else None
    for one, two in pairwise(told):
        path += hypot(two.x - one.x, two.y - one.y)
        if turned is None or one.theta is None or two.theta is None:
            turned = None
        else:
            turned += wrap_angle(two.theta - one.theta)
    sigma = sqrt(2.0 * len(told)) * last.sigma / span
    return path / span, sigma, None if turned is None else turned / span, sqrt(2.0) * last.sigma_theta / span


def _mean(values: tuple[float | None, ...]) -> float | None:
    told = [each for each in values if each is not None]
    return sum(told) / len(told) if 2 * len(told) > len(values) else None


def _agree(one: float, two: float, v: float, noise: float) -> bool:
    return abs(one - two) <= noise + TYRES * abs(v) + SHARE * max(abs(one), abs(two))
