"""Fuses what sensors measured, each reading at its own time, and judges the sensors meanwhile.

A reading may be up to `HORIZON` late: it is put in its place among the others, and everything since is taken in again.
So the order in which readings arrive makes no difference. A sensor is believed no longer when its readings lie beyond
the gate, are no numbers, stand still, stay away, or miss on one side all the time; and again when its readings have
fitted for a while. On losing belief its readings of the last `HORIZON` are taken out.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import atan2, cos, exp, hypot, inf, isfinite, sin, sqrt
from operator import attrgetter, sub
from typing import Final, NamedTuple

import numpy as np

from txt1.estimation.ekf import (
    GYRO,
    OMEGA,
    POSE,
    ROLLED,
    SIZE,
    SLIP,
    THETA,
    Array,
    Belief,
    Drift,
    Seven,
    X,
    Y,
    antenna,
    belief_of,
    encoders,
    outside,
    predict,
    turned,
    update,
    velocities,
)
from txt1.model.kinematics import wrap_angle

SPEED: Final = 0.5  # m/s, standard deviation of the speed at the start: it may be driving already
YAW_RATE: Final = 0.5  # rad/s, likewise
BIASED: Final = 0.02  # rad/s, standard deviation of the gyro's bias at the start
FIRST: Final = 0.04  # s before the first step from which on readings count
HORIZON: Final = 0.5  # s that a reading may be late
STEP_MAX: Final = 0.1  # s, the longest prediction in one piece
SAME_INSTANT: Final = 1e-6  # s between readings of one instant, to which clocks and sums of times are rounded
REJECTED_MAX: Final = 2  # readings in a row beyond the gate that cost a sensor its belief
FITS: Final = 0.5  # s for which readings fit before a sensor is believed again,
FITTING: Final = 3  # and at least so many of them
SAME_MAX: Final = 5  # equal readings in a row of a sensor that stands still
SAME_COUNTS: Final = 25  # the same of encoders that turn
MOVING: Final = 0.1  # m/s from which a position that stays the same stands still
MEMORY: Final = 25  # readings over which a sensor's misses are averaged
ONE_SIDED: Final = 0.8  # mean miss, in standard deviations of one, beyond which it is no chance: 5.6 times its own
STEERING_YAW: Final = 0.05  # rad/s by which the yaw rate may differ from the steering's, ...
STEERING_SHARE: Final = 0.1  # ... and the share of it: understeer, and a linkage that nobody has measured
EXPLAINS: Final = 0.7  # share of the misses that must be gone without a sensor that is to blame for them
EQUAL: Final = 9.0  # difference of two such sums of squares that is chance
ONE_SIDED_SO_FAR: Final = 0.28  # the same from which on the pose is told with less confidence: twice its own
LEVER: Final = 4.0  # how much further the pose may be off than its sensor's mean miss, which follows late
FORGOTTEN: Final = 30.0  # s in which a contradiction that nobody has settled is forgotten; chosen
WIDER: Final = 0.1  # standard deviation of the slip that a sensor's misses leave open where nobody is to blame
KEEPS: Final = 5.0  # s for which a sensor of the place keeps its distance from the pose, and is believed again
KEPT: Final = 3.0  # standard deviations of the place by which that may change meanwhile
LARGE: Final = 4.0  # standard deviations; a larger miss counts as this in the average
DRIFTS: Final = "drifts away from the others"
REST_SPEED: Final = 0.002  # m/s, standard deviation of the speed of a robot that stands
REST_YAW: Final = 0.001  # rad/s, likewise
ALIGNED: Final = 0.1  # rad, the standard deviation at which a heading found from positions is good enough
PAIRS_MAX: Final = 600  # positions that are kept to find it


class Kind(Enum):
    """The quantities that a measurement is of."""

    STEERING = "the steering's curvature: its change since the last one, and itself, 1/m"
    ENCODERS = "v and omega, by the encoders"
    GYRO = "omega and the gyro's bias"
    POSE = "x, y and theta"
    VELOCITY = "v and omega"


class Measurement(NamedTuple):
    """A reading as the filter takes it."""

    time: float  # when it was taken, s of the run
    sensor: str
    kind: Kind
    rows: tuple[int, ...]  # those of the kind's quantities that it has
    values: tuple[float, ...]  # m, rad, m/s, rad/s
    sigmas: tuple[float, ...]  # their standard deviations
    at: tuple[float, float] = (0.0, 0.0)  # where on the robot a pose is measured, x forward, y left, m


class Estimate(NamedTuple):
    """The robot's pose and velocities, by all sensors together."""

    x: float  # m
    y: float  # m
    theta: float  # rad in (-pi, pi]
    v: float  # m/s
    omega: float  # rad/s
    covariance: tuple[float, ...]  # of these five, row by row
    bias: float  # of the gyro, rad/s
    slip: float  # share of the wheels' way that the ground does not see
    located: bool  # whether the pose is in the frame of the sensors that tell one; else it is from where it began

    def sigma(self, place: int) -> float:
        """The standard deviation of one of the five."""
        return sqrt(max(self.covariance[6 * place], 0.0))


class Trust(NamedTuple):
    """How much a sensor is believed, and why."""

    name: str
    believed: bool
    reason: str  # why not; empty while it is
    used: int  # readings that were taken in
    rejected: int  # readings that were not
    late: int  # readings that were older than the horizon
    surprise: float  # mean of NIS over the number of values: about 1 when its covariance is right
    time: float | None  # of the last reading, s of the run


@dataclass(frozen=True, slots=True)
class Belonging:
    """A sensor's settings."""

    gate: float = 5.0  # Mahalanobis distance beyond which a reading is not believed
    timeout: float = 1.0  # s without a reading after which it is silent
    tells_pose: bool = False  # whether it tells x and y: then the pose is in its frame


@dataclass(slots=True)
class _Judge:
    """The evidence on one sensor."""

    name: str
    settings: Belonging
    believed: bool = True
    reason: str = ""
    contradicts: bool = False  # it is believed no longer, though others may be as wrong
    used: int = 0
    rejected: int = 0
    late: int = 0
    surprise: float = 1.0
    time: float | None = None
    since: float = 0.0  # when it was heard last, or began to be waited for
    beyond: int = 0  # readings in a row beyond the gate
    same: int = 0  # readings in a row that were equal
    last: tuple[float, ...] = ()
    heard: float = 0.0  # the last reading of one that contradicts, s of the run
    sigmas: tuple[float, ...] = ()  # of the last reading
    misses: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # mean misses, in standard deviations
    one_sided: float = 0.0  # the largest of these
    distance: tuple[float, float] = (inf, inf)  # from the pose to where one that is not believed has it, m
    kept_since: float = 0.0  # ... and since when, s of the run
    fitting: int = 0  # readings in a row that fitted, of a sensor that is not believed
    fitting_since: float = 0.0

    def trust(self) -> Trust:
        return Trust(
            self.name, self.believed, self.reason, self.used, self.rejected, self.late, self.surprise, self.time
        )  # fmt: skip


@dataclass(slots=True)
class _Entry:
    """A measurement in its place, and the belief after it."""

    measurement: Measurement
    belief: Belief
    time: float
    key: tuple[float, str]
    new: bool = True
    used: bool = True
    wider: Array | None = None  # what the covariance grows by there, as the reading is more than the belief knew of


class Fusion:
    """The filter of one robot.

    Args:
        sensors: by name.
        wheelbase: m.
        drift: of the state by itself.
        slip_sigma: standard deviation of the wheels' slip before anything is known of it.

    """

    def __init__(
        self,
        sensors: Mapping[str, Belonging],
        wheelbase: float,
        drift: Drift = Drift(),  # noqa: B008 - immutable
        slip_sigma: float = 0.03,
    ) -> None:
        self.changes: list[str] = []
        """What is to be told: a sensor is believed no longer, or again; whoever tells it empties the list."""
        self._wheelbase = wheelbase
        self._density = drift.density()
        self._judges = {name: _Judge(name, settings) for name, settings in sensors.items()}
        sigmas = np.array([0.0, 0.0, 0.0, SPEED, YAW_RATE, BIASED, slip_sigma])
        self._base, self._base_time = belief_of(np.zeros(sigmas.size), np.diag(sigmas**2)), -1.0
        self._entries: list[_Entry] = []
        self._arrived: list[Measurement] = []
        self._located = not any(settings.tells_pose for settings in sensors.values())
        self._pairs: deque[tuple[float, ...]] = deque(maxlen=PAIRS_MAX)
        self._now = 0.0
        self._alone = False  # one sensor only is believed
        self._suspect: _Judge | None = None  # whose readings miss on one side
        self._dispute = [0.0, 0.0, 0.0]  # m, m, rad from the pose to where those that contradict have it

    def take(self, measurement: Measurement) -> None:
        """Take in a measurement with the next step."""
        self._arrived.append(measurement)

    def rest(self, time: float) -> None:
        """Take in that the robot stands."""
        self.take(Measurement(time, "", Kind.VELOCITY, (0, 1), (0.0, 0.0), (REST_SPEED, REST_YAW)))

    def lifted(self) -> None:
        """Find the pose anew: the robot was carried elsewhere."""
        self._located = not any(judge.settings.tells_pose for judge in self._judges.values())
        self._pairs.clear()
        self._dispute = [0.0, 0.0, 0.0]

    def trusts(self) -> tuple[Trust, ...]:
        """How much each sensor is believed."""
        return tuple(judge.trust() for judge in self._judges.values())

    def step(self, now: float) -> Estimate:
        """The estimate at `now`, s of the run, with all that has arrived since the last step."""
        if any(self._dispute):
            fading = exp((self._now - now) / FORGOTTEN)
            self._dispute = [each * fading for each in self._dispute]
        self._now = now
        if self._base_time < 0.0:  # nothing is known of how it moved before
            self._base_time = max(0.0, now - FIRST)
        self._alone = sum(judge.believed for judge in self._judges.values()) < 2
        first = len(self._entries)
        for measurement in self._arrived:
            first = min(first, self._insert(measurement))
        self._arrived.clear()
        redo: int | None = first
        while redo is not None:
            redo = self._apply(redo)
        self._forget(now - HORIZON)
        for judge in self._judges.values():
            if now - judge.since > judge.settings.timeout and judge.reason != "silent":
                self._doubt(judge, "silent")
        belief, time = (self._entries[-1].belief, self._entries[-1].time) if self._entries else self._began()
        return self._estimate(self._predicted(belief, now - time))

    # -- readings in their places ----------------------------------------------------------------------------------

    def _insert(self, measurement: Measurement) -> int:
        """Put a measurement in its place; returns the place, or the end when it is not put anywhere."""
        entries, time = self._entries, measurement.time
        judge = self._judges.get(measurement.sensor)
        if judge is not None:
            judge.since = self._now
            if judge.time is None or time > judge.time:
                judge.time = time
            if not isfinite(sum(measurement.values)):
                judge.rejected += 1
                self._doubt(judge, "no number")
                return len(entries)
        if time < self._base_time or time < self._now - HORIZON or not time <= self._now + 1e-6:
            if judge is not None:
                judge.late += 1
            return len(entries)
        key = time, measurement.sensor  # of the same instant, too, there is one order
        last = not entries or entries[-1].key <= key
        place = len(entries) if last else bisect_right(entries, key, key=attrgetter("key"))
        entries.insert(place, _Entry(measurement, self._base, time, key))
        return place

    def _began(self) -> tuple[Belief, float]:
        return self._base, self._base_time

    def _forget(self, before: float) -> None:
        """Drop what is older than the horizon; the belief there is the new beginning."""
        entries = self._entries
        old = 0
        while old < len(entries) and entries[old].time < before:
            old += 1
        if old:
            self._base, self._base_time = entries[old - 1].belief, entries[old - 1].time
            del entries[:old]

    def _predicted(self, belief: Belief, dt: float, bend: float = 0.0) -> Belief:
        if dt < SAME_INSTANT and bend == 0.0:
            return belief
        while dt > STEP_MAX:
            belief, dt = predict(belief, STEP_MAX, self._density), dt - STEP_MAX
        return predict(belief, max(dt, 0.0), self._density, bend)

    def _apply(self, first: int) -> int | None:
        """Take in the entries from `first` on; returns where to begin again, if a sensor was found out meanwhile."""
        entries = self._entries
        belief, time = (entries[first - 1].belief, entries[first - 1].time) if first else self._began()
        for place in range(first, len(entries)):
            entry = entries[place]
            measurement = entry.measurement
            steering = measurement.kind is Kind.STEERING
            bend = measurement.values[0] if steering else 0.0
            belief, time = self._predicted(belief, entry.time - time, bend), entry.time
            if not steering:
                new = entry.new
                belief = self._measure(belief, entry)
                if new:
                    entry.belief = belief
                    judge = self._judges.get(measurement.sensor)
                    if self._suspect is not None:
                        suspect, self._suspect = self._suspect, None
                        suspect.misses = [0.5 * miss for miss in suspect.misses]
                        culprit = self._culprit(place)
                        if culprit is not None:
                            self._doubt(culprit, DRIFTS)
                            return self._take_out(culprit.name)
                        if suspect.settings.tells_pose:
                            offset = [miss * sigma for miss, sigma in zip(suspect.misses, suspect.sigmas, strict=False)]
                            entry.wider = wider(measurement.rows, offset, WIDER)
                    if judge is not None and not judge.believed and entry.used:
                        return self._take_out(judge.name)
            if entry.wider is not None:
                belief = belief_of(belief.mean, belief.covariance + entry.wider)
            entry.belief = belief
        return None

    def _culprit(self, last: int) -> _Judge | None:
        """The sensor without which the readings up to an entry fit best; None when they fit no better without anyone.

        Where two contradict one another and nobody takes sides it is the first in the order in which they are given,
        and the pose as the other would have it is remembered.
        """
        believed = [judge for judge in self._judges.values() if judge.believed]
        tried = [self._without(judge.name, last) for judge in believed]
        least = min((misfit for misfit, _ in tried), default=0.0)
        if least > EXPLAINS * self._without("", last)[0]:
            return None
        likely = [
            (judge, pose) for judge, (misfit, pose) in zip(believed, tried, strict=True) if misfit <= least + EQUAL
        ]
        culprit, ours = likely[0]
        culprit.contradicts = len(likely) > 1 or (culprit.settings.tells_pose and self._seldom(culprit))
        if culprit.contradicts and culprit.settings.tells_pose:
            self._disputed(self._offset(culprit))
        for _, theirs in likely[1:]:
            self._disputed(sub(*pair) for pair in zip(theirs, ours, strict=True))
        return culprit

    def _seldom(self, judge: _Judge) -> bool:
        """Whether a sensor's misses are older than the readings that are kept, so these cannot tell who is to blame."""
        return sum(entry.measurement.sensor == judge.name for entry in self._entries) < MEMORY // 2

    def _without(self, sensor: str, last: int) -> tuple[float, Sequence[float]]:
        """How one-sidedly readings up to an entry miss without a sensor, and the pose without it.

        The first is the squares of the means' z scores, summed.
        """
        belief, time = self._began()
        sums: dict[str, Array] = {}
        counts: dict[str, int] = {}
        for entry in self._entries[: last + 1]:
            measurement = entry.measurement
            steering = measurement.kind is Kind.STEERING
            bend = measurement.values[0] if steering else 0.0
            belief, time = self._predicted(belief, entry.time - time, bend), entry.time
            if steering:  # a witness too vague to be fused: the yaw rate that its angle would give
                expected = belief.mean[ROLLED] * measurement.values[1]
                miss = (expected - belief.mean[OMEGA]) / (STEERING_YAW + STEERING_SHARE * abs(expected))
                sums[""] = sums.get("", np.zeros(1)) + miss
                counts[""] = counts.get("", 0) + 1
                continue
            if measurement.sensor == sensor or not entry.used:
                continue
            residual, h = self._expect(belief.mean, measurement)
            belief, _, misses = update(belief, residual, h, measurement.sigmas)
            name = measurement.sensor
            sums[name] = sums.get(name, 0.0) + np.array(misses)
            counts[name] = counts.get(name, 0) + 1
        misfit = sum(float(np.sum(total**2)) / counts[name] for name, total in sums.items())
        return misfit, belief.mean[:3]

    def _take_out(self, sensor: str) -> int | None:
        """Leave a sensor's readings out; returns the place of the first."""
        first: int | None = None
        for place, entry in enumerate(self._entries):
            if entry.measurement.sensor == sensor and entry.used:
                entry.used, entry.new = False, False
                first = place if first is None else first
        return first

    # -- one reading -----------------------------------------------------------------------------------------------

    def _measure(self, belief: Belief, entry: _Entry) -> Belief:
        measurement = entry.measurement
        judge = self._judges.get(measurement.sensor)
        if judge is not None and not entry.new and not entry.used:
            return belief
        if entry.new and judge is not None and judge.settings.tells_pose and not self._located:
            entry.new = False
            judge.used += 1
            return self._locate(belief, measurement)
        residual, h = self._expect(belief.mean, measurement)
        sigmas = measurement.sigmas
        if judge is not None and judge.contradicts:
            self._contradict(judge, measurement, belief.mean, residual)
        if judge is None:  # a robot at rest
            return update(belief, residual, h, sigmas)[0]
        gate = judge.settings.gate**2
        if not entry.new:
            return update(belief, residual, h, sigmas, gate)[0]
        after, nis, misses = update(belief, residual, h, sigmas, gate if judge.believed else -1.0)
        entry.new, entry.used = False, judge.believed
        self._judge(judge, measurement, belief, nis, misses)
        if not judge.believed and self._keeps_its_distance(judge, measurement, belief, residual):
            self._restore(judge)
            self._disputed([*residual, 0.0][:3])
            entry.wider = wider(measurement.rows, residual)
        return after

    def _expect(self, mean: Seven, measurement: Measurement) -> tuple[Sequence[float], Sequence[Seven]]:
        """The measurement less its expectation, and the rows of the Jacobian."""
        kind, rows, values = measurement.kind, measurement.rows, measurement.values
        expected: Sequence[float]
        h: Sequence[Seven]
        if kind is Kind.GYRO:
            _, _, _, _, omega, bias, _ = mean
            return (values[0] - omega - bias,), (GYRO,)
        if kind is Kind.ENCODERS:
            expected, h = encoders(mean, self._wheelbase)
            if self._alone:
                h = [(*row[:-1], 0.0) for row in h]  # what looks like slip then is none
        elif kind is Kind.VELOCITY:
            expected, h = velocities(mean)
        elif measurement.at == (0.0, 0.0):
            expected, h = mean[:3], POSE
        else:
            position, at = antenna(mean, measurement.at)
            expected, h = (*position, mean[THETA]), (*at, POSE[THETA])
        if len(values) < len(h):
            expected, h = [expected[row] for row in rows], [h[row] for row in rows]
        residual = list(map(sub, values, expected))
        if kind is Kind.POSE and rows[-1] == THETA:
            residual[-1] = wrap_angle(residual[-1])
        return residual, h

    # -- belief ----------------------------------------------------------------------------------------------------

    def _judge(
        self, judge: _Judge, measurement: Measurement, belief: Belief, nis: float, misses: Sequence[float]
    ) -> None:
        """Weigh a new reading by its NIS and its misses."""
        count = len(misses)
        fits = nis <= judge.settings.gate**2
        judge.sigmas = measurement.sigmas
        judge.surprise += (min(nis, 100.0 * count) / count - judge.surprise) / MEMORY
        same = measurement.values == judge.last
        judge.same = judge.same + 1 if same else 0
        judge.last = measurement.values
        if measurement.kind is Kind.ENCODERS:  # whole counts are often the same, but not for so long
            frozen = judge.same >= SAME_COUNTS and any(measurement.values)
        else:
            moving = measurement.kind is not Kind.POSE or abs(belief.mean[ROLLED]) > MOVING or not judge.believed
            frozen = judge.same >= SAME_MAX and moving
        time = measurement.time
        means, one_sided = judge.misses, 0.0
        for place, miss in enumerate(misses):
            if not -LARGE <= miss <= LARGE:
                miss = LARGE if miss > 0.0 else -LARGE
            means[place] = mean = means[place] + (miss - means[place]) / MEMORY
            one_sided = max(one_sided, mean, -mean)
        judge.one_sided = one_sided
        if not judge.believed:
            judge.rejected += 1
            if not fits or frozen or (judge.reason == DRIFTS and one_sided > 2.0 * ONE_SIDED):
                judge.fitting = 0
                return
            if judge.fitting == 0:
                judge.fitting_since = time
            judge.fitting += 1
            if judge.fitting >= FITTING and time - judge.fitting_since >= FITS:
                self._restore(judge)
            return
        if frozen:
            self._doubt(judge, "stands still")
            return
        if not fits:
            judge.rejected += 1
            judge.beyond += 1
            if judge.beyond >= REJECTED_MAX:
                self._doubt(judge, "disagrees with the others")
            return
        judge.used += 1
        judge.beyond = 0
        if one_sided > ONE_SIDED:
            self._suspect = judge

    def _doubt(self, judge: _Judge, reason: str) -> None:
        judge.fitting = judge.beyond = 0
        judge.distance = inf, inf
        judge.misses, judge.one_sided = [0.0, 0.0, 0.0], 0.0
        if judge.believed:
            self.changes.append(f"'{judge.name}' is not believed any more: {reason}")
        judge.believed, judge.reason = False, reason

    def _restore(self, judge: _Judge) -> None:
        judge.believed, judge.reason, judge.fitting, judge.surprise = True, "", 0, 1.0
        judge.contradicts = False
        self.changes.append(f"'{judge.name}' is believed again")

    # -- contradictions that nobody settles ------------------------------------------------------------------------

    def _disputed(self, further: Iterable[float]) -> None:
        """Move the pose as those would have it that contradict, by m, m, rad."""
        self._dispute = [so_far + more for so_far, more in zip(self._dispute, further, strict=True)]

    def _offset(self, judge: _Judge) -> list[float]:
        """How far off x, y and theta may be by a sensor's mean misses, m, m, rad."""
        offset = [LEVER * miss * sigma for miss, sigma in zip(judge.misses, judge.sigmas, strict=False)]
        return [*offset, 0.0][:3]

    def _contradict(self, judge: _Judge, measurement: Measurement, mean: Seven, residual: Sequence[float]) -> None:
        """Go on as a sensor would that contradicts: its velocities less ours, since its last reading."""
        before, judge.heard = judge.heard, measurement.time
        dt = min(max(measurement.time - before, 0.0), STEP_MAX)
        told = dict(zip(measurement.rows, residual, strict=True))
        if measurement.kind is Kind.POSE:  # it says by itself where it has the pose
            self._disputed([(told.get(place, 0.0) - self._dispute[place]) / MEMORY for place in range(3)])
        elif measurement.kind is Kind.GYRO:
            self._disputed((0.0, 0.0, told[0] * dt))
        else:
            way = told.get(0, 0.0) * dt
            self._disputed((way * cos(mean[THETA]), way * sin(mean[THETA]), told.get(1, 0.0) * dt))

    def _doubts(self) -> list[float]:
        """Variances of x, y and theta besides the filter's: of contradictions, and of sensors that miss on one side."""
        x, y, theta = self._dispute
        doubts = [x * x + y * y, x * x + y * y, theta * theta]  # in any direction: the sensor may be wrong in any
        for judge in self._judges.values():
            if judge.settings.tells_pose and judge.believed and judge.one_sided > ONE_SIDED_SO_FAR:
                for place, (miss, offset) in enumerate(zip(judge.misses, self._offset(judge), strict=False)):
                    if abs(miss) > ONE_SIDED_SO_FAR:
                        doubts[place] += offset * offset
        return doubts

    def _keeps_its_distance(
        self, judge: _Judge, measurement: Measurement, belief: Belief, residual: Sequence[float]
    ) -> bool:
        """Whether the only sensor that tells the place has been as far from the pose as now for `KEEPS` seconds.

        Then it no longer drifts, and nothing else knows the place; how far it was stays a doubt of the pose.
        """
        others = any(each.settings.tells_pose and each.believed for each in self._judges.values())
        if others or measurement.rows[:2] != (X, Y) or measurement.kind is not Kind.POSE:
            return False
        x, y = judge.distance
        sigma = sqrt(belief.covariance[X, X] + belief.covariance[Y, Y] + measurement.sigmas[X] ** 2)
        kept = hypot(residual[X] - x, residual[Y] - y) <= KEPT * sigma
        if not kept or judge.same >= SAME_MAX:
            judge.distance, judge.kept_since = (residual[X], residual[Y]), measurement.time
        return measurement.time - judge.kept_since >= KEEPS

    # -- start-up without a pose -----------------------------------------------------------------------------------

    def _locate(self, belief: Belief, measurement: Measurement) -> Belief:
        """Find the pose in the frame of a sensor: at once with a heading, from several positions without one."""
        mean, values, sigmas = belief.mean, measurement.values, measurement.sigmas
        if measurement.rows == (0, 1, 2):
            turn = values[2] - mean[THETA]
            spread = np.diag(np.square(sigmas))
            (px, py), _ = antenna(mean, measurement.at)
            c, s = cos(turn), sin(turn)
            x, y = values[0] - c * px + s * py, values[1] - s * px - c * py
        elif measurement.rows == (0, 1):
            (px, py), _ = antenna(mean, measurement.at)
            self._pairs.append((px, py, *values, sigmas[0]))
            found = aligned(self._pairs)
            if found is None:
                return belief
            turn, x, y, spread = found
            spread = about(spread, mean, turn, self._pairs)
        else:
            return belief
        self._base = turned(self._base, turn, x, y, spread)
        for entry in self._entries:
            entry.belief = turned(entry.belief, turn, x, y, spread)
        self._located = True
        self._pairs.clear()
        self.changes.append(f"the pose is known, by '{measurement.sensor}'")
        return turned(belief, turn, x, y, spread)

    # -- the estimate ----------------------------------------------------------------------------------------------

    def _estimate(self, belief: Belief) -> Estimate:
        x, y, theta, _, omega, bias, slip = belief.mean
        v, told = outside(belief)
        covariance = list(told)
        for place, doubt in enumerate(self._doubts()):
            covariance[6 * place] += doubt
        return Estimate(x, y, wrap_angle(theta), v, omega, tuple(covariance), bias, slip, self._located)


def wider(rows: Sequence[int], offset: Sequence[float], slip: float = 0.0) -> Array:
    """The covariance of x, y and theta that are off so far, and of the slip, shape (7, 7)."""
    spread = np.zeros((SIZE, SIZE))
    for row, each in zip(rows, offset, strict=False):
        spread[row, row] = each * each
    spread[SLIP, SLIP] = slip * slip
    return spread


def aligned(pairs: deque[tuple[float, ...]]) -> tuple[float, float, float, Array] | None:
    """The turn (rad) and move (m) that bring positions p onto measured ones z, and their covariance; None: too vague.

    Least squares in closed form, S. Umeyama, PAMI 13(4), 1991, in the plane and without scale: with both centred,
    turn = atan2(sum p x z, sum p . z). Its variance is sigma^2 / sum |p|^2, that of the centre sigma^2 / n. Each pair
    is p, z, and sigma, m.
    """
    if len(pairs) < 5:
        return None
    px, py, zx, zy, sigma = np.array(pairs).T
    cx, cy, dx, dy = px.mean(), py.mean(), zx.mean(), zy.mean()
    px, py, zx, zy = px - cx, py - cy, zx - dx, zy - dy
    spread, variance = float(px @ px + py @ py), float(np.mean(sigma**2))
    if spread * ALIGNED**2 < variance:
        return None
    turn = atan2(float(px @ zy - py @ zx), float(px @ zx + py @ zy))
    c, s = cos(turn), sin(turn)
    return (
        turn,
        float(dx - c * cx + s * cy),
        float(dy - s * cx - c * cy),
        np.diag((variance / len(pairs), variance / len(pairs), variance / spread)),
    )


def about(spread: Array, mean: Seven, turn: float, pairs: deque[tuple[float, ...]]) -> Array:
    """The covariance of a frame (x, y, turn) at the centre of the pairs, at where the robot is instead."""
    px, py = np.mean([pair[:2] for pair in pairs], axis=0)
    dx, dy = mean[X] - float(px), mean[Y] - float(py)
    c, s = cos(turn), sin(turn)
    j = np.eye(3)
    j[0, 2], j[1, 2] = -(s * dx + c * dy), c * dx - s * dy
    moved: Array = j @ spread @ j.T
    return moved
