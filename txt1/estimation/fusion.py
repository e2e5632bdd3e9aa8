"""Fuses what sensors measured, each reading at its own time, and judges the sensors meanwhile.

A reading may be up to `HORIZON` late: it is put in its place among the others, and everything since is taken in again.
So the order in which readings arrive makes no difference. A sensor is believed no longer when its readings lie beyond
the gate, are no numbers, stand still, stay away, or miss on one side all the time; and again when its readings have
fitted for a while. On losing belief its readings of the last `HORIZON` are taken out.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, exp, isfinite, sin
from operator import attrgetter, sub
from typing import Final

import numpy as np

from txt1.estimation.alignment import about, aligned
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
    Row,
    Seven,
    antenna,
    belief_of,
    encoders,
    outside,
    predict,
    turned,
    update,
    velocities,
)
from txt1.estimation.judge import DRIFTS, MEMORY, ONE_SIDED, Belonging, Judge, Trust
from txt1.estimation.measurement import Kind, Measurement
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle

SPEED: Final = 0.5  # m/s, standard deviation of the speed at the start: it may be driving already
YAW_RATE: Final = 0.5  # rad/s, likewise
BIASED: Final = 0.02  # rad/s, standard deviation of the gyro's bias at the start
FIRST: Final = 0.04  # s before the first step from which on readings count
HORIZON: Final = 0.5  # s that a reading may be late
STEP_MAX: Final = 0.1  # s, the longest prediction in one piece
SAME_INSTANT: Final = 1e-6  # s between readings of one instant, to which clocks and sums of times are rounded
STEERING_YAW: Final = 0.05  # rad/s by which the yaw rate may differ from the steering's, ...
STEERING_SHARE: Final = 0.1  # ... and the share of it: understeer, and a linkage that nobody has measured
EXPLAINS: Final = 0.7  # share of the misses that must be gone without a sensor that is to blame for them
EQUAL: Final = 9.0  # difference of two such sums of squares that is chance
ONE_SIDED_SO_FAR: Final = 0.28  # the same from which on the pose is told with less confidence: twice its own
FORGOTTEN: Final = 30.0  # s in which a contradiction that nobody has settled is forgotten; chosen
WIDER: Final = 0.1  # standard deviation of the slip that a sensor's misses leave open where nobody is to blame
REST_SPEED: Final = 0.002  # m/s, standard deviation of the speed of a robot that stands
REST_YAW: Final = 0.001  # rad/s, likewise
PAIRS_MAX: Final = 600  # positions that are kept to find it
XX: Final = 0  # place of x's variance in a covariance's triangle
YY: Final = 7  # ... and of y's


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
        self._judges = {name: Judge(name, settings) for name, settings in sensors.items()}
        sigmas = np.array([0.0, 0.0, 0.0, SPEED, YAW_RATE, BIASED, slip_sigma])
        self._base, self._base_time = belief_of(np.zeros(sigmas.size), np.diag(sigmas**2)), -1.0
        self._entries: list[_Entry] = []
        self._arrived: list[Measurement] = []
        self._located = not any(settings.tells_pose for settings in sensors.values())
        self._pairs: deque[tuple[float, ...]] = deque(maxlen=PAIRS_MAX)
        self._now = 0.0
        self._alone = False  # one sensor only is believed
        self._suspect: Judge | None = None  # whose readings miss on one side
        self._dispute = [0.0, 0.0, 0.0]  # m, m, rad from the pose to where those that contradict have it
        self._way_doubt = (0.0, 0.0)  # m in x and y by which the pose may be off, as the speed may be

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
        self._way_doubt = 0.0, 0.0

    def believes(self, sensor: str) -> bool:
        """Whether a sensor is fused and believed."""
        judge = self._judges.get(sensor)
        return judge is not None and judge.believed

    def doubt_speed(self, speed: float, dt: float) -> None:
        """Note that the speed may have been off by `speed` m/s for dt seconds, so that the pose is off by the way."""
        if speed:
            theta = (self._entries[-1].belief if self._entries else self._base).mean[THETA]
            x, y = self._way_doubt
            self._way_doubt = x + speed * dt * cos(theta), y + speed * dt * sin(theta)

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
        self._alone = [judge.believed for judge in self._judges.values()].count(True) < 2
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
                self._tell(judge.doubt("silent"))
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
                self._tell(judge.doubt("no number"))
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
        if bend == 0.0 and dt < SAME_INSTANT:
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
                            self._tell(culprit.doubt(DRIFTS))
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

    def _culprit(self, last: int) -> Judge | None:
        """The sensor without which the readings up to an entry fit best; None when they fit no better without anyone.

        Where two contradict one another and nobody takes sides it is the first in the order in which they are given,
        and the pose as the other would have it is remembered.
        """
        judged = [judge for judge in self._judges.values() if self._located or not judge.settings.tells_pose]
        believed = [judge for judge in judged if judge.believed]
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
            self._disputed(culprit.offset())
        for _, theirs in likely[1:]:
            self._disputed(sub(*pair) for pair in zip(theirs, ours, strict=True))
        return culprit

    def _seldom(self, judge: Judge) -> bool:
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
            entry.new = entry.used = False  # in a frame that is still to be found: it says nothing on anybody's errors
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
        if measurement.kind is Kind.POSE and after is not belief and any(self._way_doubt):
            x, y = self._way_doubt  # the reading takes away of the error what it takes of the variance
            before, left = belief.triangle, after.triangle
            self._way_doubt = x * left[XX] / before[XX], y * left[YY] / before[YY]
        used = judge.used
        self._tell(judge.weigh(measurement, belief.mean[ROLLED], nis, misses))
        if judge.used > used and judge.one_sided > ONE_SIDED:
            self._suspect = judge
        if self._nobody_else_knows(judge) and judge.keeps_its_distance(measurement, belief, residual):
            self._tell(judge.restore())
            self._disputed([*residual, 0.0][:3])
            entry.wider = wider(measurement.rows, residual)
        return after

    def _tell(self, news: str) -> None:
        if news:
            self.changes.append(news)

    def _nobody_else_knows(self, judge: Judge) -> bool:
        """Whether this sensor tells the place, and none that is believed does.

        When it keeps its distance it no longer drifts; how far it was then stays a doubt of the pose.
        """
        if judge.believed or not judge.settings.tells_pose:
            return False
        return not any(each.believed for each in self._judges.values() if each.settings.tells_pose)

    def _expect(self, mean: Seven, measurement: Measurement) -> tuple[Sequence[float], Sequence[Row]]:
        """The measurement less its expectation, and the rows of the Jacobian."""
        kind, rows, values = measurement.kind, measurement.rows, measurement.values
        expected: Sequence[float]
        h: Sequence[Row]
        if kind is Kind.GYRO:
            _, _, _, _, omega, bias, _ = mean
            return (values[0] - omega - bias,), (GYRO,)
        if kind is Kind.ENCODERS:
            expected, h = told = encoders(mean, self._wheelbase)
            if self._alone:
                h = [(*row[:-1], 0.0) for row in told[1]]  # what looks like slip then is none
        elif kind is Kind.VELOCITY:
            expected, h = velocities(mean)
        elif measurement.at == (0.0, 0.0):
            expected, h = mean[:3], POSE
        else:
            position, at = antenna(mean, measurement.at)
            expected, h = (*position, mean[THETA]), (*at, THETA)
        if len(values) < len(h):
            expected, h = [expected[row] for row in rows], [h[row] for row in rows]
        residual = list(map(sub, values, expected))
        if kind is Kind.POSE and rows[-1] == THETA:
            residual[-1] = wrap_angle(residual[-1])
        return residual, h

    # -- belief ----------------------------------------------------------------------------------------------------

    # -- contradictions that nobody settles ------------------------------------------------------------------------

    def _disputed(self, further: Iterable[float]) -> None:
        """Move the pose as those would have it that contradict, by m, m, rad."""
        self._dispute = [so_far + more for so_far, more in zip(self._dispute, further, strict=True)]

    def _contradict(self, judge: Judge, measurement: Measurement, mean: Seven, residual: Sequence[float]) -> None:
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
        way_x, way_y = self._way_doubt
        doubts[0] += way_x * way_x
        doubts[1] += way_y * way_y
        for judge in self._judges.values():
            if judge.settings.tells_pose and judge.believed and judge.one_sided > ONE_SIDED_SO_FAR:
                for place, (miss, offset) in enumerate(zip(judge.misses, judge.offset(), strict=False)):
                    if abs(miss) > ONE_SIDED_SO_FAR:
                        doubts[place] += offset * offset
        return doubts

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
        doubts = self._doubts()
        if any(doubts):
            covariance = list(told)
            for place, doubt in enumerate(doubts):
                covariance[6 * place] += doubt
            told = tuple(covariance)
        return Estimate(x, y, wrap_angle(theta), v, omega, told, bias, slip, self._located)


def wider(rows: Sequence[int], offset: Sequence[float], slip: float = 0.0) -> Array:
    """The covariance of x, y and theta that are off so far, and of the slip, shape (7, 7)."""
    spread = np.zeros((SIZE, SIZE))
    for row, each in zip(rows, offset, strict=False):
        spread[row, row] = each * each
    spread[SLIP, SLIP] = slip * slip
    return spread
