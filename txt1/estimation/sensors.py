"""Makes measurements for the filter of sensors' readings, by the type of their values.

Readings of a fast sensor that arrive together count as one, as their errors are independent. So the filter has half the
work (preintegration: T. Lupton, S. Sukkarieh, IEEE T-RO 28(1), 2012).
"""

from collections.abc import Callable, Sequence
from enum import Enum
from math import sqrt
from operator import attrgetter
from typing import Any, Final, NamedTuple

from txt1.estimation.settings import FusedConfig, Quantity
from txt1.model.kinematics import wrap_angle
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, TrackerReading
from txt1.units import new

# of the rows of a pose
HEADING: Final = 2


class Kind(Enum):
    """The quantities that a measurement is of."""

    ENCODERS = "v and omega, by the encoders"
    GYRO = "omega and the gyro's bias"
    POSE = "x, y and theta"
    VELOCITY = "v and omega"
    TURN = "how far it has turned by wheels and by gyro, rad, in how long, s, and to both sides together, rad"


# the same by names of their own: in Python 3.11 an enum's attribute takes 70 to 100 ns, and a step asks for some fifty
KIND_ENCODERS, KIND_GYRO, KIND_POSE, KIND_VELOCITY, KIND_TURN = Kind


class Measurement(NamedTuple):
    """A reading as the filter takes it."""

    # when it was taken, s of the run
    time: float
    sensor: str
    kind: Kind
    # those of the kind's quantities that it has
    rows: tuple[int, ...]
    # m, rad, m/s, rad/s
    values: tuple[float, ...]
    # their standard deviations
    sigmas: tuple[float, ...]
    # where on the robot a pose is measured, x forward, y left, m
    at: tuple[float, float] = (0.0, 0.0)


QUANTITIES: Final[dict[Kind, tuple[Quantity, ...]]] = {
    KIND_POSE: ("x", "y", "theta"),
    KIND_VELOCITY: ("v", "omega"),
    KIND_GYRO: ("omega",),
}

SIGMAS: Final[dict[type, dict[Quantity, float]]] = {
    # rad/s; assumed for a 3DM-GX2
    ImuReading: {"omega": 0.006},
    # m, where the receiver tells none; rad
    FixReading: {"x": 1.0, "y": 1.0, "theta": 0.2},
    # m, rad; assumed
    TrackerReading: {"x": 0.002, "y": 0.002, "theta": 0.003, "v": 0.05, "omega": 0.1},
}
"""Standard deviations of readings that tell none; of a tracker they are the first guess, see `LearnedNoise`."""
# s, the longest period in which a car's acceleration moves it by less than a tracker's noise
FAST: Final = 0.012
# threes of readings over which its noise is averaged
NOISE_AVERAGED: Final = 100
# of the first guess, below which no noise is believed: errors that last, as of a lens
NOISE_SHARE_MIN: Final = 0.25
# sigma, beyond which a difference is an outlier
OUTLIER_SIGMA: Final = 3.0

USUAL: Final[dict[type, tuple[Quantity, ...]]] = {
    ImuReading: ("omega",),
    FixReading: ("x", "y"),
    TrackerReading: ("x", "y", "theta"),
}
"""The quantities that are taken where nothing else is configured."""


class LearnedNoise:
    """The white noise of a fast tracker, by the second differences of its readings: their variance is 6 sigma^2.

    The motion cancels in them, but for the acceleration (J. von Neumann, Ann. Math. Stat. 12(4), 1941).
    """

    def __init__(self, sigmas: Sequence[float]) -> None:
        self.sigmas = tuple(sigmas)
        """The standard deviations that are believed; those at the start are the first guess."""
        self._least = [(NOISE_SHARE_MIN * each) ** 2 for each in sigmas]
        self._variances = [each * each for each in sigmas]
        self._times = (-1.0, -1.0)
        self._last: tuple[Sequence[float], Sequence[float]] = ((), ())

    def take(self, time: float, values: Sequence[float]) -> None:
        """Take in a pose (x, y, theta; m, rad) at a time, s."""
        (first, second), (one, two) = self._times, self._last
        self._times, self._last = (second, time), (two, values)
        if first < 0.0 or not 0.0 < second - first <= FAST or abs(time - 2.0 * second + first) > 0.1 * FAST:
            return
        # the next three: differences of the same readings tell little more
        self._times = (-1.0, -1.0)
        bends = [now - last - (last - before) for now, last, before in zip(values, two, one, strict=True)]
        bends[2] = wrap_angle(bends[2])
        for place, (bend, variance) in enumerate(zip(bends, self._variances, strict=True)):
            square, most = bend * bend / 6.0, OUTLIER_SIGMA * OUTLIER_SIGMA * variance
            # also when it is not a number
            found = variance + ((square if square < most else most) - variance) / NOISE_AVERAGED
            self._variances[place] = found if found > self._least[place] else self._least[place]
        self.sigmas = tuple(map(sqrt, self._variances))


def wanted(kind: type, settings: FusedConfig) -> tuple[Quantity, ...]:
    """The quantities that are taken of values of this type; none, if it cannot be fused and nothing is configured."""
    return USUAL.get(kind, ()) if settings.fields is None else settings.fields


def plan(name: str, kind: type, settings: FusedConfig) -> Callable[[Reading[Any]], list[Measurement]]:
    """The function that makes measurements of a sensor's readings, one for each kind of quantity in it.

    Numbers become Python's: a single numpy.float32 among them would make the whole filter one of 7 digits. Readings are
    anybody's, so they have no type here that the compiled wheel would insist on.
    """
    taken = wanted(kind, settings)
    given, assumed, delay = settings.sigma, SIGMAS[kind], settings.delay
    ahead, left = settings.lever
    if kind is ImuReading:
        sigma, factor = (given.get("omega", assumed["omega"]),), 1.0 + settings.scale

        def gyro(reading: Reading[Any]) -> list[Measurement]:
            turning = float(reading.value.rates[2]) / factor
            return [new(Measurement, (reading.time - delay, name, KIND_GYRO, (0,), (turning,), sigma, (0.0, 0.0)))]

        return gyro if "omega" in taken else lambda reading: []

    noise = LearnedNoise([assumed[each] for each in QUANTITIES[KIND_POSE]]) if kind is TrackerReading else None
    parts = []
    for what in (KIND_POSE, KIND_VELOCITY):
        rows = tuple(row for row, quantity in enumerate(QUANTITIES[what]) if quantity in taken)
        quantities = [QUANTITIES[what][row] for row in rows]
        usual = tuple([float(given.get(quantity) or assumed.get(quantity, 0.1)) for quantity in quantities])
        # those that may tell their own standard deviation, by their places
        own = [
            place
            for place, quantity in enumerate(quantities)
            if quantity not in given and hasattr(kind, f"sigma_{quantity}")
        ]
        if rows:
            its = _fields([f"sigma_{quantities[place]}" for place in own]) if own else None
            parts.append((what, rows, _fields(quantities), usual, own, its, noise if what is KIND_POSE else None))

    def moving(reading: Reading[Any]) -> list[Measurement]:
        value, time, made = reading.value, reading.time - delay, []
        mount = value.mount
        at = mount[0] + ahead, mount[1] + left
        for what, rows, told, usual, own, its, learned in parts:
            values, sigmas = told(value), usual
            if learned is not None:
                learned.take(reading.time, values if len(values) == 3 else (value.x, value.y, value.theta))
                sigmas = learned.sigmas
                if len(own) < 3:
                    sigmas = tuple([sigmas[row] if place in own else usual[place] for place, row in enumerate(rows)])
            if its is not None and any(mine := its(value)):
                told_too = dict(zip(own, mine, strict=True))
                sigmas = tuple([float(told_too.get(place) or sigma) for place, sigma in enumerate(sigmas)])
            if None in values:
                known = [place for place, each in enumerate(values) if each is not None]
                values, sigmas = tuple([values[place] for place in known]), tuple([sigmas[place] for place in known])
                rows = tuple([rows[place] for place in known])
            if values:
                made.append(new(Measurement, (time, name, what, rows, tuple(map(float, values)), sigmas, at)))
        return made

    return moving


def _fields(names: Sequence[str]) -> Callable[[Any], tuple[Any, ...]]:
    """The function that tells these fields of a value; of a single one, too, in a tuple."""
    if len(names) > 1:
        return attrgetter(*names)
    one: Callable[[Any], Any] = attrgetter(*names)
    return lambda value: (one(value),)


# s within which readings of a sensor are averaged that arrive together
SLOT: Final = 0.02
# the same of positions in time: the newest tells most of where the car is now
NEWEST: Final = 0.005
# s between readings of one instant, to which clocks and sums of times are rounded
SAME_INSTANT: Final = 1e-6


def alike(one: Measurement, two: Measurement) -> bool:
    """Whether two readings of a kind of a sensor may be averaged."""
    time, _, kind, rows, _, _, at = one
    time_too, _, _, rows_too, _, _, at_too = two
    within = SLOT if kind is KIND_GYRO else NEWEST if kind is KIND_POSE else 0.0
    return abs(time - time_too) < within - SAME_INSTANT and rows == rows_too and at == at_too


def averaged(mean: Measurement, count: int, more: Measurement) -> Measurement:
    """The mean of `count` readings and one more, with independent errors."""
    share = 1.0 / (count + 1)
    less = sqrt(1.0 - share)
    time, sensor, kind, rows, values, sigmas, at = mean
    time += share * (more.time - time)
    means = [one + share * (two - one) for one, two in zip(values, more.values, strict=True)]
    if rows[-1] == HEADING:
        means[-1] = values[-1] + share * wrap_angle(more.values[-1] - values[-1])
    return new(Measurement, (time, sensor, kind, rows, tuple(means), tuple([less * sigma for sigma in sigmas]), at))
