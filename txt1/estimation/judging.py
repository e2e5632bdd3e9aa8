"""The evidence on a sensor: four rules by which a reading is taken in, and a fifth further below.

A sixth is in `hypotheses`.

1. **Valid.** A reading is ignored that is no number, never changes, is later than `fusion.HORIZON`, or of the future,
   and so is a position that is told again. A sensor that gives no others is left out. These faults show without any
   other sensor.
2. **Near.** A position within the gate is taken in, a single one beyond it is not.
3. **Adaptive.** A sensor that measures the pose, is fresh and agrees with itself is right where dead reckoning
   contradicts it: the model of the car is wrong, as wheels slip and servos lag. From the second reading beyond 99 % of
   chi-square on, the covariance grows until the miss is what it expects, and the reading is taken in: the strong
   tracking filter, D. H. Zhou, P. M. Frank, Int. J. Control 65(2), 1996.
   Where another sensor of positions that is no less precise was taken in within a second, their frames differ: this one
   is left out.
   What hides in the noise of single positions shows in their mean: wheels that err, or the sensor itself. Which of the
   two does is not told apart, so the pose stays, and by so much it is told to be uncertain.
4. **Jump.** A reading that does not agree with its sensor's own last one, as nothing moves so fast, has two
   explanations: the sensor's frame has jumped, or the robot was carried away. Readings are left out, while the estimate
   tells the covariance of both hypotheses (Bar-Shalom, Li, Kirubarajan 2001, 1.4.16). They are taken in again when
   they are back, or, if no other sensor tells the place, after `KEEPS_FOR` without another leap: then the robot was
   carried.

The fifth rule: three witnesses of the yaw rate vote, and an absolute position overrules the wheels.

Over `WINDOW` the gyro, the wheels, and a third witness (an absolute heading, else the steering) tell how far the robot
has turned. Two that agree outvote the third: mid-value selection, the common voter of redundant sensors (R. J. Patton,
P. M. Frank, R. N. Clark, *Fault Diagnosis in Dynamic Systems*, Prentice Hall 1989). They agree within what slip,
understeer and unequal tyres explain, as these are the car's model and no fault. A gyro that was outvoted has to agree
more closely to be believed again, as in a curve that much would hide its fault. A late reading is no witness.

The wheels' speed has one better witness, an absolute position. It is always right, by the rules above. The way is
that of the most precise sensor alone: from one sensor's position to another's there is no way, only their errors.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import dist, sqrt
from typing import Final, NamedTuple

from txt1.estimation.sensors import KIND_ENCODERS, KIND_POSE, Measurement
from txt1.estimation.settings import Trust
from txt1.model.kinematics import wrap_angle

# s for which readings fit before a sensor that failed is believed again,
FITS_FOR: Final = 0.5
# and at least so many of them
FITTING: Final = 3
# equal readings in a row of a sensor that stands still
SAME_MAX: Final = 5
# the same of encoders that turn
SAME_COUNTS: Final = 25
# m/s from which a position that stays the same stands still
MOVING: Final = 0.1
# readings over which a sensor's misses are averaged
MISSES_AVERAGED: Final = 25
# s over which the misses of positions are averaged
MISSED_FOR: Final = 4.0
# m/s, more than a robot moves at, driven or carried
MOVES_BY: Final = 5.0
# rad/s, likewise
TURNS_BY: Final = 10.0
# standard deviations that the difference of two readings may have besides
DIFFERENCE_SIGMA: Final = 3.5
# the same of one reading's
APART: Final = DIFFERENCE_SIGMA * sqrt(2.0)
# s for which a sensor of the place stays where it jumped to, and is believed again
KEEPS_FOR: Final = 5.0
# s in which it is forgotten what may have moved the pose: an overruled reckoning, a gyro, a frame; chosen
FORGOTTEN: Final = 10.0
# probability of the other hypothesis: that a jump was the robot's, that a sensor drifts away
OTHER: Final = 0.2
# readings after a leap, before anybody may have been carried anywhere
SEVERAL: Final = 3
# chi-square of 1, 2, 3 numbers at 99 %
CHI99: Final[tuple[float, ...]] = (6.635, 9.210, 11.345)


@dataclass(frozen=True, slots=True)
class Belonging:
    """A sensor's settings."""

    # Mahalanobis distance beyond which a reading is not simply taken in
    gate: float = 5.0
    # s without a reading in time after which it is left out
    timeout: float = 1.0
    # whether it tells x and y: then the pose is in its frame
    tells_pose: bool = False


@dataclass(slots=True)
class Judge:
    """The evidence on one sensor."""

    name: str
    settings: Belonging
    believed: bool = True
    reason: str = ""
    used: int = 0
    rejected: int = 0
    late: int = 0
    surprise: float = 1.0
    time: float | None = None
    # when a reading came in time, or began to be waited for
    since: float = 0.0
    # when any reading came
    heard: float = 0.0
    # readings in a row that were equal; of encoders since something else was asked of them
    same: int = 0
    # when the first of them came, s of the run
    same_since: float = 0.0
    last: tuple[float, ...] = ()
    # the last reading of the pose that was taken in
    placed: Measurement | None = None
    # the last reading of the pose, m, m, rad
    own: tuple[float, ...] = ()
    own_at: float = 0.0  # s of the run
    # the residual of a reading beyond the gate, m, m, rad
    missed: tuple[float, ...] = ()
    missed_at: float = 0.0  # s of the run
    # when its readings leapt away from the pose, s of the run
    jumped_at: float | None = None
    # readings since then
    jumped: int = 0
    # the mean by which positions without a heading have missed the pose, m, and its variances, m^2
    mean_miss: tuple[float, float] = (0.0, 0.0)
    mean_variance: tuple[float, float] = (0.0, 0.0)
    # readings in a row that fitted, of a sensor that is not believed
    fitting: int = 0
    fitting_since: float = 0.0

    def trust(self) -> Trust:
        """How much it is believed, and why."""
        return Trust(
            self.name, self.believed, self.reason, self.used, self.rejected, self.late, self.surprise, self.time
        )

    def frozen(self, measurement: Measurement, speed: float, asked_at: float) -> str:
        """Note a reading like the last one; return its fault, or "" if it has none.

        `speed` is the wheels', m/s; something else was asked of them at `asked_at`, s of the run.
        """
        encoders = measurement.kind is KIND_ENCODERS
        # those of a car that goes on as it was asked to may stay the same
        self.same += not encoders or asked_at > self.same_since
        if encoders:
            # whole counts are often the same, but not for so long; those of a car that stands are
            stands = not any(measurement.values) and (self.believed or abs(speed) < MOVING)
            frozen = self.same >= SAME_COUNTS and not stands
        else:
            moving = measurement.kind is not KIND_POSE or abs(speed) > MOVING or not self.believed
            frozen = self.same >= SAME_MAX and moving
        return "stands still" if frozen else ""

    def surprised(self, nis: float, count: int) -> None:
        """Note a reading's NIS and the count of its numbers."""
        self.surprise += ((nis / count if nis < 100.0 * count else 100.0) - self.surprise) / MISSES_AVERAGED

    def leapt(self, measurement: Measurement, *, fits: bool) -> bool:
        """Note a reading of the pose; return whether no car can have moved so far since the last reading.

        One that fits, like the last ones, has not leapt.
        """
        time, _, _, rows, values, sigmas, _ = measurement
        before, dt = self.own, max(time - self.own_at, 0.0)
        self.own, self.own_at = values, time
        if len(before) != len(values) or (fits and self.jumped_at is None and not self.missed):
            return False
        for place, there in enumerate(before):
            step, reach = values[place] - there, MOVES_BY
            if rows[place] == 2:
                step, reach = wrap_angle(step), TURNS_BY
            if not abs(step) <= reach * dt + APART * sigmas[place]:
                return True
        return False

    def averaged(self, dt: float, residual: Sequence[float], variances: tuple[float, float]) -> None:
        """Note by how much a position has missed the pose, m, and the variances of that, dt seconds after the last."""
        share = min(dt / MISSED_FOR, 1.0)
        (x, y), (xx, yy), keeps = self.mean_miss, self.mean_variance, 1.0 - share
        self.mean_miss = keeps * x + share * residual[0], keeps * y + share * residual[1]
        keeps, share = keeps * keeps, share * share
        self.mean_variance = keeps * xx + share * variances[0], keeps * yy + share * variances[1]

    def lasting(self) -> tuple[float, float]:
        """By how much positions miss the pose for long, m, less what chance does: 2 of the chi-square, on average."""
        (x, y), (xx, yy) = self.mean_miss, self.mean_variance
        if not xx:
            return 0.0, 0.0
        left = sqrt(1.0 - 2.0 / max(x * x / xx + y * y / yy, 2.0))
        return left * x, left * y

    def misses_again(self, measurement: Measurement, residual: Sequence[float]) -> bool:
        """Note a reading beyond 99 %; return whether the last was beyond it, too, so it is no single outlier."""
        before, dt = self.missed, max(measurement.time - self.missed_at, 0.0)
        self.missed, self.missed_at = tuple(residual), measurement.time
        if len(before) != len(residual):
            return False
        reach = [(TURNS_BY if row == 2 else MOVES_BY) * dt for row in measurement.rows]
        both = zip(residual, before, measurement.sigmas, strict=True)
        if sum([here * there / (sigma * sigma) for here, there, sigma in both]) < 0.0:
            # on both sides of the pose: noise
            return False
        near = zip(residual, before, reach, measurement.sigmas, strict=True)
        return all(abs(here - there) <= far + APART * sigma for here, there, far, sigma in near)

    def fits(self, time: float) -> bool:
        """Note a reading that fits, of a disbelieved sensor; return whether readings have fitted for long enough."""
        if self.fitting == 0:
            self.fitting_since = time
        self.fitting += 1
        return self.fitting >= FITTING and time - self.fitting_since >= FITS_FOR

    def doubt(self, reason: str) -> str:
        """Disbelieve the sensor; return a message if it was believed before."""
        self.fitting = 0
        news = f"'{self.name}' is not believed any more: {reason}" if self.believed else ""
        self.believed, self.reason = False, reason
        return news

    def restore(self) -> str:
        """Believe the sensor again; return the message."""
        news = "" if self.believed else f"'{self.name}' is believed again"
        self.believed, self.reason, self.fitting, self.surprise = True, "", 0, 1.0
        self.jumped_at, self.jumped, self.missed = None, 0, ()
        self.mean_miss = self.mean_variance = 0.0, 0.0
        return news


WINDOW: Final = 0.3  # s
# s that an absolute reading may be old
READING_AGE_MAX: Final = 0.5
# cycles
CYCLES_MIN: Final = 8
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
SLIDING_SPEED: Final = 0.15


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
        self._places: dict[str, deque[Measurement]] = {}

    def clear(self) -> None:
        """Forget everything: the robot was carried elsewhere."""
        self.apart = 0.0
        self._cycles.clear()
        self._places.clear()

    def cycle(self, cycle: WitnessValues) -> None:
        """Take in a cycle."""
        cycles, time = self._cycles, cycle.time
        cycles.append(cycle)
        while time - cycles[0].time > WINDOW + READING_AGE_MAX:
            cycles.popleft()

    def place(self, measurement: Measurement) -> None:
        """Take in an absolute reading that was taken in by the filter, one for each piece of the path."""
        time, places = measurement.time, self._places.setdefault(measurement.sensor, deque())
        if places and time - places[-1].time < LEG:
            return
        places.append(measurement)
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
        fresh = [places for places in self._places.values() if end - places[-1].time <= READING_AGE_MAX]
        if fresh:
            places = min(fresh, key=lambda each: each[-1].sigmas[0])
            seen = _seen(places)
            if seen is not None:
                begin, end = places[0].time, places[-1].time
        cycles = [each for each in self._cycles if begin < each[0] <= end]
        if len(cycles) < CYCLES_MIN:
            return False, False
        _, speeds, turns, gyros, steerings = zip(*cycles, strict=True)
        v, wheels, gyro, third = sum(speeds) / len(cycles), sum(turns) / len(cycles), _mean(gyros), _mean(steerings)
        self.turn_alike = gyro is not None and abs(gyro - (1.0 - slip) * wheels) <= YAW + TYRES * abs(v)
        noise, sliding = YAW, False
        if seen is not None:
            speed, sigma, turning, uncertain = seen
            v_share = SHARE * max(speed, abs(v))
            sliding = abs(speed - abs(v)) > SLIDING_SPEED + v_share + 4.0 * sigma
            if turning is not None:
                third, noise = turning, YAW + 4.0 * uncertain
        if gyro is None or third is None or _agree(gyro, wheels, v, YAW):
            return False, sliding
        gyro_agrees, wheels_agree = _agree(gyro, third, v, noise), _agree(wheels, third, v, noise)
        return wheels_agree and not gyro_agrees, sliding or (gyro_agrees and not wheels_agree)


def _seen(told: deque[Measurement]) -> tuple[float, float, float | None, float] | None:
    """Speed (m/s) and its sigma, yaw rate (rad/s; None) and its sigma, by a sensor's absolute readings."""
    first, last = told[0], told[-1]
    span = last.time - first.time
    if span < 0.5 * WINDOW:
        return None
    path = sum([dist(one, two) for one, two in pairwise([each.values[:2] for each in told])])
    headings = [each.values[2] for each in told if len(each.values) > 2]
    turned: float | None = sum([wrap_angle(two - one) for one, two in pairwise(headings)]) / span
    if len(headings) < len(told):
        turned = None
    return path / span, sqrt(2.0 * len(told)) * last.sigmas[0] / span, turned, sqrt(2.0) * last.sigmas[-1] / span


def _mean(values: tuple[float | None, ...]) -> float | None:
    told = [each for each in values if each is not None]
    return sum(told) / len(told) if 2 * len(told) > len(values) else None


def _agree(one: float, two: float, v: float, noise: float) -> bool:
    return abs(one - two) <= noise + TYRES * abs(v) + SHARE * max(abs(one), abs(two))
