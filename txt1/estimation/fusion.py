"""Fuses the readings of all sensors, each at its own time, and judges the sensors meanwhile.

A reading may be up to `HORIZON` late. It is inserted at its time, and all later steps are computed again. So the order
in which readings arrive makes no difference. Each belief is one of `filter`.

The rules by which a reading is taken in are in `txt1.estimation.judging` and `hypotheses`; what else may be true is in
`hypotheses`, and counts in the covariance that is told. Errors of the car's model count as process noise that adapts to
the innovations (A. H. Mohamed, K. P. Schwarz, J. Geodesy 73, 1999; strong tracking if a single innovation is too
large). Such errors are hard starts, servos that lag, and slip. The difference between the wheels' yaw rate and the
gyro's shows slip where the track width is exact, else that width.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, isfinite, sin, sqrt
from operator import attrgetter, sub
from typing import Final, NamedTuple

import numpy as np

from txt1.estimation.filter import (
    BB,
    BIAS,
    OMEGA,
    OUTWARDS,
    ROLLED,
    SCALE,
    SIZE,
    SLID,
    SLIP,
    SS,
    START_SPEED_SIGMA,
    STEP_MAX,
    THETA,
    TRACKS,
    WIDTH,
    YY,
    Array,
    Belief,
    Drift,
    Lean,
    Row,
    Walk,
    antenna,
    belief_of,
    considered,
    encoders,
    grown,
    late_by,
    moved,
    outside,
    predict,
    ramped,
    slip_unknown,
    slipping,
    turned,
    update,
    upright,
    velocities,
    wandering,
    widened,
)
from txt1.estimation.hypotheses import LEVER, PICKS_GAP_MAX, USUAL_SLIP, Besides, Frame, Reckoning, aligned, bent
from txt1.estimation.judging import (
    CHI99,
    KEEPS_FOR,
    MOVING,
    OTHER,
    SEVERAL,
    STALE,
    Belonging,
    Judge,
    Vote,
    WitnessValues,
)
from txt1.estimation.sensors import (
    KIND_ENCODERS,
    KIND_GYRO,
    KIND_POSE,
    KIND_TURN,
    KIND_VELOCITY,
    SAME_INSTANT,
    SLOT,
    Kind,
    Measurement,
    alike,
    averaged,
)
from txt1.estimation.settings import Trust
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.units import new

# m and rad, standard deviations of the pose that it counts from: next to nothing, yet positive
BEGUN: Final = 1e-4
# rad/s, likewise
YAW_RATE: Final = 0.5
# rad/s, standard deviation of the gyro's bias at the start
BIASED: Final = 0.02
# s before the first step from which on readings count
READINGS_BEFORE: Final = 0.04
# s that a reading may be late
HORIZON: Final = 0.5
# rad from which a turn tells of the slip
CURVE: Final = 0.1
# s over which the slip of two moments is related: floors, starts and stops; chosen
FLOOR: Final = 2.0
# m/s^2: rubber on a dry floor has 10, racing tyres some more
HOLDS: Final = 15.0
# standard deviation of the track width up to which it is exact, as a share
TRACK_KNOWN: Final = 0.01
# of the wheels' way; more is no slip any more, but wheels that tell nothing
SLIP_MAX: Final = 0.6
# m/s, standard deviation of the speed of a robot that stands
REST_SPEED: Final = 0.002
# rad/s, likewise
REST_YAW: Final = 0.001
# positions that are kept to find the frame
PAIRS_MAX: Final = 600
OUTVOTED: Final = "is contradicted by two others"
WHEELS: Final = "the car moves otherwise than its wheels tell"
JUMPED: Final = "has jumped"
MOVES: Final = "tells a way that no car goes: its frame moves"
# probability that a stated value is wrong, before anything was measured
WRONG: Final = 0.1
FRAMES: Final = "measures in another frame than"
# s by which a gyro's readings are older than they say: anything up to their period
GYRO_CLOCK: Final = 0.01 / sqrt(12.0)
# of a gyro's scale, where it is stated to be exact
KNOWN_SCALE: Final = 1e-6
# s in which another sensor has told the place
RECENT: Final = 1.0

_KEY: Final = attrgetter("key")


@dataclass(slots=True)
class _Entry:
    """A measurement in its place, and the belief after it."""

    measurement: Measurement
    belief: Belief
    key: tuple[float, str]
    # s by which its time was put back already, as its sensor is late
    late: float = 0.0
    # whether it is still to be judged: once, though it may be computed again
    new: bool = True
    # whether it counts in the belief
    used: bool = True
    # nothing is known of the slip before it
    fresh: bool = False
    # m, m by which the pose is put elsewhere before it, and the slip
    moved: tuple[float, float, float] | None = None
    # what the covariance grows by before it, as it is more than the model expects
    wider: Array | None = None


class Calibrated(NamedTuple):
    """A quantity with its standard deviation, and the one at the start."""

    value: float
    sigma: float
    start: float


class Fusion:
    """The filter of one robot.

    Args:
        sensors: by name.
        drift: of the state by itself.
        slip_sigma: standard deviation of the wheels' slip before anything is known of it.
        start: the pose at the start and its standard deviations (m, m, rad), if they are known.
        gyro_scale: standard deviation of the share by which a gyro reads too much; 0: there is no gyro, or it is exact.
        track_sigma: standard deviation of the share by which the wheels turn more than the car, as their track width is
            another than was measured. Up to `TRACK_KNOWN` it is exact, and wheels that turn otherwise than a gyro tell
            of their slip. Else they tell of the width, and never of the way.
        mounts: standard deviations of the place (m) and the delay (s) of sensors of positions, by name.

    """

    def __init__(
        self,
        sensors: Mapping[str, Belonging],
        drift: Drift = Drift(),  # noqa: B008 - immutable
        slip_sigma: float = 0.03,
        start: tuple[Sequence[float], Sequence[float]] | None = None,
        gyro_scale: float = 0.0,
        track_sigma: float = 0.0,
        mounts: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        self.changes: list[str] = []
        """Messages for the event log: a sensor is believed no longer, or again. The caller that tells them empties the
        list."""
        self.vote = Vote()
        self._reckoning = Reckoning()
        self._frames = {name: Frame() for name, settings in sensors.items() if settings.tells_pose}
        # how much it slides outwards in curves, and the standard deviation of that, s^2/m, where nothing tells of it
        self.sideways = 0.0, drift.sideways
        self._exact = track_sigma <= TRACK_KNOWN
        self.track_sigma = 0.0 if self._exact else track_sigma
        """Standard deviation of the track width at the start, as a share of it; 0: it is exact."""
        self._walk = Walk(drift, slip_sigma, exact=self._exact)
        self._judges = {name: Judge(name, settings) for name, settings in sensors.items()}
        pose, known = start or ((0.0,) * 3, (BEGUN,) * 3)
        sigmas = np.array([*known, START_SPEED_SIGMA, YAW_RATE, BIASED, slip_sigma, self.track_sigma])
        # of the parameters of a belief's lean, those of each sensor of positions: ahead, left (m), and late (s)
        self._places_of: dict[str, int] = {}
        spreads = [gyro_scale] if gyro_scale else []
        if mounts:
            spreads = [gyro_scale or KNOWN_SCALE, drift.sideways, GYRO_CLOCK]
            for name, (lever, late) in mounts.items():
                self._places_of[name] = len(spreads)
                spreads += [lever, lever, late]
        self._parameters = np.array(spreads)
        lean = Lean(0.0 * self._parameters, np.zeros((SIZE, len(spreads))), np.diag(self._parameters**2))
        # with its time
        self._base = belief_of((*pose, 0.0, 0.0, 0.0, 0.0, 0.0), np.diag(sigmas**2), lean if spreads else None), -1.0
        self._entries: list[_Entry] = []
        # of them, those that are taken in
        self._settled = 0
        self._arrived: list[Measurement] = []
        self._located = start is not None or not any(settings.tells_pose for settings in sensors.values())
        # with how the first two of each lean
        self._pairs: deque[tuple[tuple[float, ...], Array | None]] = deque(maxlen=PAIRS_MAX)
        self._now = 0.0
        self._gyros: set[str] = set()
        self._headings: set[str] = set()
        self._wheels_of: set[str] = set()
        # whether something has changed of these, or of the next four
        self._changed = True
        self.turning = False
        """Whether a gyro is believed."""
        # whether a sensor that tells the wheels' speed is believed
        self._rolling = False
        # whether one that tells the place is
        self._placed = False
        # whether one that tells headings is
        self._headed = False
        # s of the run, of a gyro's newest reading
        self._turned_at = -inf
        self._besides = Besides()
        self.asked_at = inf
        """s of the run, when another speed or angle was asked of the wheels last; infinite: nobody tells."""

    def take(self, measurement: Measurement) -> None:
        """Take in a measurement with the next step."""
        self._arrived.append(measurement)

    def rest(self, time: float) -> None:
        """Take in that the robot stands."""
        self.take(Measurement(time, "", KIND_VELOCITY, (0, 1), (0.0, 0.0), (REST_SPEED, REST_YAW)))

    def lifted(self) -> None:
        """Find the pose anew: the robot was carried elsewhere."""
        self._located = not any(judge.settings.tells_pose for judge in self._judges.values())
        self._pairs.clear()
        self.vote.clear()
        self._besides = Besides()
        self._frames = {name: Frame() for name in self._frames}
        for judge in self._judges.values():
            judge.own, judge.jumped_at, judge.missed = (), None, ()
            judge.mean_miss = judge.mean_variance = 0.0, 0.0

    def believes(self, sensor: str) -> bool:
        """Whether a sensor is fused and believed."""
        judge = self._judges.get(sensor)
        return judge is not None and judge.believed

    @property
    def placing(self) -> tuple[str, ...]:
        """The sensors of positions of which mount and clock are learned."""
        return tuple(self._places_of)

    def parameters(self, sensor: str) -> dict[str, Calibrated]:
        """What is known of a sensor of positions beyond what is stated, and of the wheels and the gyro.

        "x", "y" of the mount (m), "delay" (s), "slip", "scale", "bias" of the gyro (rad/s), and "sideways" (s^2/m).
        """
        belief = self._newest()[0]
        known, at = upright(belief), self._places_of[sensor]
        assert belief.lean is not None
        mean, sigmas = belief.lean.value, np.sqrt(np.diag(belief.lean.covariance))
        places = {"x": at, "y": at + 1, "delay": at + 2, "scale": SCALE, "sideways": OUTWARDS}
        found = {name: (mean[place], sigmas[place], self._parameters[place]) for name, place in places.items()}
        found["slip"] = belief.mean[SLIP], sqrt(known.triangle[SS]), self._walk.slip_sigma
        found["bias"] = belief.mean[BIAS], sqrt(known.triangle[BB]), BIASED
        return {name: Calibrated(*map(float, each)) for name, each in found.items()}

    @property
    def turn_share(self) -> float:
        """By how much the wheels turn more than the car, as their track width is another than was measured."""
        return 1.0 if self._exact else 1.0 + self._newest()[0].mean[WIDTH]

    @property
    def gyro_share(self) -> float:
        """By how much a gyro reads more than the car turns, its bias aside."""
        lean = self._newest()[0].lean
        return 1.0 if lean is None else 1.0 + float(lean.value[SCALE])

    @property
    def track(self) -> tuple[float, float]:
        """The share by which the track width is larger than was measured, and its standard deviation."""
        belief = upright(self._newest()[0])
        return belief.mean[WIDTH], sqrt(belief.triangle[-1])

    def trusts(self) -> tuple[Trust, ...]:
        """How much each sensor is believed."""
        return tuple(judge.trust() for judge in self._judges.values())

    def step(self, now: float) -> Estimate:
        """The estimate at `now`, s of the run, with all that has arrived since the last step."""
        since, self._now = now - self._now, now
        # without another sensor of the place nothing tells better
        if self._placed:
            self._besides.fade(since)
        # nothing is known of how it moved before
        if self._base[1] < 0.0:
            self._base = self._base[0], max(0.0, now - READINGS_BEFORE)
            for judge in self._judges.values():
                judge.since = now
        # by sensor, kind, and s by which they were put back
        groups: dict[tuple[str, Kind, float], tuple[Measurement, int]] = {}
        oldest = max(self._base[1], now - HORIZON)
        lean = self._newest()[0].lean
        for measurement in self._arrived:
            late = 0.0
            if lean is not None and measurement.sensor in self._places_of:
                # no reading was taken after it had come; one of the future stays there
                late = float(lean.value[self._places_of[measurement.sensor] + 2])
                late = max(late, min(measurement.time - now, 0.0))
                measurement = measurement._replace(time=measurement.time - late)
            if not self._admits(measurement, oldest):
                continue
            group = measurement.sensor, measurement.kind, late
            mean, count = groups.get(group, (measurement, 0))
            if count and not alike(mean, measurement):
                self._insert(mean, late)
                count = 0
            groups[group] = averaged(mean, count, measurement) if count else measurement, count + 1
        for (_, _, late), (measurement, _) in groups.items():
            self._insert(measurement, late)
        self._arrived.clear()
        if self._changed:
            self._note_believed()
        self._apply()
        self._forget(now - HORIZON)
        for judge in self._judges.values():
            if now - judge.since > judge.settings.timeout:
                missing = "silent" if judge.heard <= judge.since else "not in time"
                if judge.reason != missing:
                    self._tell(judge.doubt(missing))
        belief, time = self._newest()
        estimate = self._estimate(self._predicted(belief, time, now) if now - time >= SAME_INSTANT else belief)
        if not self._placed:
            doubted = bent(estimate.covariance[12]) * estimate.v
            self._besides.drive(belief.mean[THETA], doubted, since)
        return estimate

    def _note_believed(self) -> None:
        """Note which sensors are believed now, for the steps that are computed next."""
        self._changed = False
        believed = {name for name, judge in self._judges.items() if judge.believed}
        self._placed = not believed.isdisjoint(self._frames)
        self.turning = not believed.isdisjoint(self._gyros)
        self._rolling = not believed.isdisjoint(self._wheels_of)
        self._headed = not believed.isdisjoint(self._headings)

    def cycle(self, cycle: WitnessValues, dt: float) -> None:
        """Take in the witnesses' values for a cycle of dt seconds; wheels that fail by themselves are no witness."""
        for name in self._wheels_of:
            if not self._judges[name].believed and self._judges[name].reason != WHEELS:
                self.vote.clear()
                self._reckoning.clear()
                return
        self.vote.cycle(cycle)
        frames = self._frames
        if not frames or not self._located:
            return
        _, v, turning, gyro, _ = cycle
        omega = gyro if gyro is not None and self.turning else turning
        belief = self._newest()[0]
        self._reckoning.go(cycle.time, dt, v, omega, belief.mean[SLIP], self._slides(belief)[0])
        for frame in frames.values():
            frame.compare(self._reckoning)

    def judge_by_vote(self) -> None:
        """Leave out an outvoted gyro or outvoted wheels, unless no other sensor measures the same quantity."""
        self.vote.compare(turning=self.turning)
        gyro_off, wheels_off = self.vote.outvoted(self._newest()[0].mean[SLIP] if self._exact else 0.0)
        placed = self._located and self._placed
        # whoever outvoted a gyro and has failed since was no witness
        alone = not self._rolling and not self._headed
        for names, off, close, reason in (
            (self._gyros, gyro_off and not alone, self.vote.turn_alike or alone, OUTVOTED),
            (self._wheels_of, wheels_off and placed, True, WHEELS),
        ):
            for name in names:
                judge = self._judges[name]
                if off and judge.believed:
                    self._tell(judge.doubt(reason))
                    self._take_out(name, self.vote.apart if name in self._gyros else 0.0)
                    self._note_believed()
                    self._apply()
                elif judge.believed or judge.reason != reason:
                    continue
                elif off or not close:
                    judge.fitting = 0
                elif judge.fits(self._now) or (alone and reason is OUTVOTED):
                    self._tell(judge.restore())
                    mine = [each for each in self._entries if each.measurement.sensor == name]
                    if mine:
                        mine[-1].used = True

    def _believed(self) -> list[Judge]:
        return [judge for judge in self._judges.values() if judge.believed]

    # -- readings in their places ----------------------------------------------------------------------------------

    def _admits(self, measurement: Measurement, oldest: float) -> bool:
        """Whether a reading is valid in itself, and not older than that, s."""
        time, sensor, kind, rows, values, sigmas, _ = measurement
        now, judge = self._now, self._judges.get(sensor)
        recent = oldest <= time <= now + SAME_INSTANT
        if judge is None:
            return recent
        judge.heard = now
        if judge.time is None:
            self._changed = True
            if kind is KIND_GYRO:
                self._gyros.add(sensor)
            elif kind is KIND_ENCODERS:
                self._wheels_of.add(sensor)
            elif kind is KIND_POSE and rows[-1] == THETA:
                self._headings.add(sensor)
        if not recent:
            judge.late += 1
            return False
        judge.since = now
        if not isfinite(sum(values, sum(sigmas, 0.0))) or min(sigmas) <= 0.0:
            wrong = "no number"
        else:
            wrong = ""
            if values == judge.last:
                wrong = judge.frozen(measurement, self._newest()[0].mean[ROLLED], self.asked_at)
            else:
                judge.same, judge.last, judge.same_since = 0, values, now
        if judge.time is None or time > judge.time:
            judge.time = time
            if kind is KIND_GYRO:
                self._turned_at = time
        if wrong:
            judge.rejected += 1
            self._tell(judge.doubt(wrong))
            return False
        # a position that is told again is no news: its errors are those of the last one
        return not judge.same or kind is not KIND_POSE

    def _insert(self, measurement: Measurement, late: float) -> None:
        """Insert a reading, or the mean of some, at its time, put back by `late` seconds already."""
        entries = self._entries
        # of the same instant, too, there is one order
        key = (round(measurement.time / SAME_INSTANT), measurement.sensor)
        last = not entries or entries[-1].key <= key
        place = len(entries) if last else bisect_right(entries, key, key=_KEY)
        entries.insert(place, _Entry(measurement, self._base[0], key, late))
        if place < self._settled:
            self._settled = place

    def _newest(self) -> tuple[Belief, float]:
        """The belief after all that is taken in, and its time."""
        if not self._settled:
            return self._base
        entry = self._entries[self._settled - 1]
        return entry.belief, entry.measurement.time

    def _forget(self, before: float) -> None:
        """Drop all steps before the horizon; the belief at the horizon is the new beginning."""
        entries = self._entries
        old = 0
        while old < len(entries) and entries[old].measurement.time < before:
            old += 1
        if old:
            self._base = entries[old - 1].belief, entries[old - 1].measurement.time
            del entries[:old]
            self._settled -= old

    def _predicted(self, belief: Belief, begin: float, end: float) -> Belief:
        """The belief at `end`, s of the run, of one at `begin`."""
        dt, sideways, walk = end - begin, self._slides(belief), self._walk
        density, moves = walk.told, abs(belief.mean[ROLLED]) > MOVING
        # of a car that stands, slip does not change
        blind = moves and begin > walk.blind_from
        if not self.turning:
            density = walk.settled(belief.triangle[SS]) if self._rolling else walk.untold(density)
            if self._rolling and not self._placed:
                belief = slipping(belief, dt, 2.0 * FLOOR * walk.slip_sigma**2)
        elif not self._rolling:
            density = walk.untold(density)
        elif self._exact:
            density = walk.blind if blind else density
        else:
            density = walk.settled(belief.triangle[SS]) if blind or not self._placed else density
            if moves:
                belief = wandering(belief, dt, walk.slip_sigma, FLOOR)
        while dt > STEP_MAX:
            belief, dt = predict(belief, STEP_MAX, density, sideways), dt - STEP_MAX
        return predict(belief, dt if dt > 0.0 else 0.0, density, sideways)

    def _slides(self, belief: Belief) -> tuple[float, float]:
        """How much it slides outwards, and what of that is not in the belief's lean, as `filter.predict` has it."""
        return (float(belief.lean.value[OUTWARDS]), 0.0) if belief.lean and self._places_of else self.sideways

    def _apply(self) -> None:
        """Take in the entries that are not yet."""
        belief, time = self._newest()
        for entry in self._entries[self._settled :]:
            at = entry.measurement.time
            if at - time >= SAME_INSTANT:
                belief = self._predicted(belief, time, at)
            time = at
            if entry.fresh or not -SLIP_MAX < belief.mean[SLIP] < SLIP_MAX:
                belief = slip_unknown(belief, self._walk.slip_sigma, self.track_sigma)
            if entry.moved is not None:
                belief = moved(belief, entry.moved)
            if entry.wider is not None:
                belief = widened(belief, entry.wider)
            entry.belief = belief = self._measure(belief, entry)
        self._settled = len(self._entries)

    def _take_out(self, sensor: str, by: float) -> None:
        """Leave a sensor's readings out that were taken in; before them it may have turned the pose by that, rad."""
        first = None
        for place, entry in enumerate(self._entries[: self._settled]):
            compared = sensor in self._gyros and entry.measurement.kind is KIND_TURN
            if (entry.measurement.sensor == sensor or compared) and entry.used:
                entry.used, entry.new = False, False
                self._settled = min(place, self._settled)
                first = first or entry
        if first is not None and sensor in self._gyros:
            # what it told of the slip, too
            first.fresh = True
            first.wider = np.zeros((SIZE, SIZE)) if first.wider is None else first.wider
            first.wider[THETA, THETA] += by * by

    # -- one reading -----------------------------------------------------------------------------------------------

    def _measure(self, belief: Belief, entry: _Entry) -> Belief:
        measurement, unjudged = entry.measurement, entry.new
        if not unjudged and not entry.used:
            return belief
        _, sensor, kind, _, _, sigmas, _ = measurement
        if kind is KIND_TURN:
            entry.new = False
            return self._turned(belief, measurement, unjudged=unjudged) if self.turning else belief
        judge = self._judges.get(sensor)
        if not self._located and unjudged and judge is not None and judge.settings.tells_pose:
            # in a frame that is still to be found: it says nothing on anybody's errors
            entry.new = entry.used = False
            judge.used += 1
            judge.leapt(measurement, fits=True)
            return self._locate(belief, entry)
        residual, h, leans = self._expect(belief, entry)
        # a robot at rest
        if judge is None:
            return update(belief, residual, h, sigmas)[0]
        if kind is KIND_POSE:
            return self._place(belief, entry, judge)
        sigmas = sigmas[: len(residual)]
        after, nis, misses = update(belief, residual, h, sigmas, leans)
        if kind is KIND_GYRO:
            after = late_by(after, after.mean[OMEGA] - belief.mean[OMEGA])
        if kind is KIND_ENCODERS or (kind is KIND_GYRO and not -TRACKS <= misses[0] <= TRACKS):
            after = self._tracked(belief, after, measurement, residual, h, misses, leans)
        if unjudged:
            entry.new, entry.used = False, judge.believed
            judge.surprised(nis, len(misses))
            if judge.believed:
                judge.used += 1
            else:
                judge.rejected += 1
                if judge.reason not in (OUTVOTED, WHEELS) and judge.fits(measurement.time):
                    self._tell(judge.restore())
                    entry.used = True
        return after if entry.used else belief

    def _tracked(
        self,
        belief: Belief,
        after: Belief,
        measurement: Measurement,
        residual: Sequence[float],
        h: Sequence[Row],
        misses: Sequence[float],
        leans: Array | None,
    ) -> Belief:
        """The belief with the rates of wheels or a gyro; strong tracking, if any misses by more than chance."""
        wheels, rows, wide = measurement.kind is KIND_ENCODERS, measurement.rows, belief
        sigmas = measurement.sigmas[: len(residual)]
        for row, left, miss in zip(rows, residual, misses, strict=False):
            if not -TRACKS <= miss <= TRACKS:
                speed = wheels and row == 0
                wide = ramped(wide, ROLLED if speed else OMEGA, left * left, SLOT)
                if speed and abs(left) > HOLDS * SLOT:
                    # wheels that lock or spin: the car's speed is anywhere between its last one and theirs
                    sigmas = (abs(left), *sigmas[1:])
        # the yaw rate, if it counts, is the last of both
        if wheels and rows[len(residual) - 1] == 1 and not self._headed:
            return considered(wide, residual, h, sigmas)
        return after if wide is belief else update(wide, residual, h, sigmas, leans)[0]

    def _turned(self, belief: Belief, measurement: Measurement, *, unjudged: bool) -> Belief:
        """The belief with how far the wheels turned the robot beside the gyro: it tells of bias and slip."""
        told, by_gyro, dt, path = measurement.values
        bias, leans = belief.mean[BIAS], None
        # of the wheels' turn, in the car's: by their slip if the track width is exact, else by the width
        share = 1.0 / (1.0 - belief.mean[SLIP]) if self._exact else 1.0 + belief.mean[WIDTH]
        if belief.lean is not None:
            by_gyro /= 1.0 + float(belief.lean.value[SCALE])
            leans = np.zeros((1, len(belief.lean.value)))
            leans[0, SCALE] = -by_gyro * share
        turned_by = by_gyro - bias * dt
        residual = (told - share * turned_by,)
        # wheels that stand tell nothing of slip: the gyro's noise in both is the same, and would be taken for some
        moving = turned_by if told else 0.0
        of_slip, of_width = (share * share * moving, 0.0) if self._exact else (0.0, moving)
        h = ((0.0, 0.0, 0.0, 0.0, 0.0, -share * dt, of_slip, of_width),)
        # the slip walks within the turn, too: its mean is so far from the last one
        sigma = hypot(measurement.sigmas[0], path * sqrt(self._walk.told[SLIP] * dt / 3.0))
        after, _, (miss,) = update(belief, residual, h, (sigma,), leans)
        if unjudged and abs(turned_by) > CURVE and miss:
            chance = (residual[0] / miss) ** 2
            self._walk.changed((residual[0] ** 2 - chance) / turned_by**2 + self._walk.told[SLIP] * dt, dt)
        return after

    def _place(self, belief: Belief, entry: _Entry, judge: Judge) -> Belief:
        """The belief with a reading of the pose, by the rules of `txt1.estimation.judging`."""
        measurement = entry.measurement
        sigmas, expected = measurement.sigmas, belief.triangle
        residual, h, leans = self._expect(belief, entry)
        after, nis, _ = update(belief, residual, h, sigmas, leans, tells=self._rolling)
        if not entry.new:
            return after if entry.used else belief
        entry.new = False
        gate = judge.settings.gate**2
        judge.surprised(nis, len(residual))
        fits = nis <= CHI99[len(residual) - 1]
        leapt = judge.leapt(measurement, fits=fits)
        frame = self._frames.get(judge.name)
        if frame is not None:
            if leapt:
                frame.clear()
            elif frame.due(measurement.time):
                self._compare_frame(frame, entry, belief)
            likely = frame.moves or (judge.reason == MOVES and frame.probability > OTHER)
            # without wheels nothing tells
            if likely and measurement.time - self._reckoning.until < PICKS_GAP_MAX:
                return self._moving_frame(belief, entry, judge, frame, residual)
        if nis > gate:
            judge.fitting = 0
            if leapt or judge.jumped_at is not None:
                return self._jumped(belief, entry, judge, residual, leapt=leapt)
        if not judge.believed:
            elsewhere = judge.reason.startswith(FRAMES) and self._placed_by_another(judge, measurement)
            soon = judge.reason != JUMPED and not (nis > gate or judge.fits(measurement.time))
            if soon or (nis > gate and elsewhere):
                return _left_out(belief, entry, judge)
            self._pulls_again(judge, belief, after)
            self._tell(judge.restore())
        judge.jumped_at, judge.jumped = None, 0
        if fits:
            judge.missed = ()
        elif judge.misses_again(measurement, residual):
            other = self._placed_by_another(judge, measurement)
            if other:
                self._tell(judge.doubt(f"{FRAMES} '{other}'"))
                return _left_out(belief, entry, judge)
            # strong tracking: dead reckoning is off by what is missed, and so may the slip be
            entry.wider = grown(measurement.rows, residual, SLID if self._rolling else 0.0)
            before, belief = belief, widened(belief, entry.wider)
            after = update(belief, residual, h, sigmas, leans, tells=self._rolling)[0]
            self._besides.overrule(before, after)
        elif nis > gate:
            return _left_out(belief, entry, judge)
        judge.used += 1
        time, earlier = measurement.time, judge.placed and judge.placed.time
        if measurement.rows == (0, 1):
            noise = sigmas[0] * sigmas[0]
            judge.averaged(time - (earlier or 0.0), residual, (expected[0] + noise, expected[YY] + noise))
        if measurement.rows[:2] == (0, 1):
            self._walk.placed(time, earlier)
        judge.placed = measurement
        self._accepted(measurement, belief, after)
        return after

    def _placed_by_another(self, judge: Judge, measurement: Measurement) -> str:
        """The name of another sensor, no less precise, that told the same within the last second; empty: none."""
        row, sigma = measurement.rows[0], measurement.sigmas[0]
        for each in self._believed():
            last = each.placed
            if each is judge or last is None or measurement.time - last.time >= RECENT:
                continue
            if dict(zip(last.rows, last.sigmas, strict=False)).get(row, inf) <= sigma:
                return each.name
        return ""

    def _accepted(self, measurement: Measurement, before: Belief, after: Belief) -> None:
        self._besides.place(before, after)
        if measurement.rows[:2] == (0, 1):
            self.vote.place(measurement)

    def _jumped(self, belief: Belief, entry: _Entry, judge: Judge, residual: Sequence[float], *, leapt: bool) -> Belief:
        """A reading after a leap: left out, until it is clear that the robot was carried."""
        measurement = entry.measurement
        if leapt or judge.jumped_at is None:
            judge.jumped_at, judge.jumped = measurement.time, 0
        judge.jumped += 1
        others = any(each.settings.tells_pose for each in self._believed() if each is not judge)
        if measurement.time - judge.jumped_at >= KEEPS_FOR and not others:
            entry.wider = grown(measurement.rows, residual, 0.0)
            wide = widened(belief, entry.wider)
            wanted, h, leans = self._expect(wide, entry)
            after = update(wide, wanted, h, measurement.sigmas, leans)[0]
            where = f"{hypot(*residual[:2]):.2g} m away" if measurement.rows[:2] == (0, 1) else "elsewhere"
            self._tell(f"'{judge.name}' stays {where}: the robot was carried there")
            self._pulls_again(judge, belief, after)
            judge.restore()
            judge.used += 1
            self._accepted(measurement, wide, after)
            return after
        if judge.jumped >= SEVERAL:
            if judge.reason != MOVES:
                self._tell(judge.doubt(JUMPED))
            if not others:
                self._besides.missed(measurement.rows, residual)
        return _left_out(belief, entry, judge)

    def _moving_frame(
        self, belief: Belief, entry: _Entry, judge: Judge, frame: Frame, residual: Sequence[float]
    ) -> Belief:
        """Leave out a reading in a frame that moves; it returns as a reading after a leap."""
        measurement = entry.measurement
        judge.jumped_at, judge.jumped, judge.fitting = measurement.time, SEVERAL, 0
        if judge.believed:
            self._tell(judge.doubt(MOVES))
            self.vote.clear()
            # back to where dead reckoning has it since the frame stood
            (x, y, sigma), (*past, past_sigma) = frame.pulled, frame.past
            if sigma or any(frame.past):
                entry.moved = -x, -y, self._reckoning.slip
                entry.wider = grown((0, 1), [OTHER * x, OTHER * y], USUAL_SLIP)
                entry.wider[[0, 1], [0, 1]] += sigma * sigma + past_sigma * past_sigma
                entry.wider[:2, :2] += np.outer(past, past)
                belief = moved(belief, entry.moved)
                belief = widened(belief, entry.wider)
        frame.refuse(measurement.time)
        if not any(each.settings.tells_pose for each in self._believed()):
            self._besides.missed(measurement.rows, residual)
        return _left_out(belief, entry, judge)

    def _pulls_again(self, judge: Judge, before: Belief, after: Belief) -> None:
        """Note what a sensor whose frame has moved pulls the pose by, as it is believed again.

        It may stand somewhere else than it did, or the reckoning was off meanwhile.
        """
        if judge.reason == MOVES:
            x, y = before.mean[:2]
            self._frames[judge.name].past = after.mean[0] - x, after.mean[1] - y, 0.0

    def _tell(self, news: str) -> None:
        if news:
            self.changes.append(news)
            self._changed = True

    def _compare_frame(self, frame: Frame, entry: _Entry, belief: Belief) -> None:
        """Let a reading tell of its sensor's frame, by the mount and the clock that are known now."""
        measurement = entry.measurement
        lean, first = belief.lean, self._places_of.get(measurement.sensor)
        if lean is not None and first is not None:
            ahead, left, late = lean.value[first : first + 3].tolist()
            late -= entry.late
            x, y, theta, *rest = belief.mean
            belief = belief_of((x, y, theta - late * rest[1], *rest), belief.covariance, lean)
            at = measurement.at[0] + ahead, measurement.at[1] + left
            measurement = measurement._replace(time=measurement.time - late, at=at)
            frame.lever = max(LEVER, sqrt(np.diag(lean.covariance)[first : first + 2].max()))
        frame.take(measurement, upright(belief))

    def _expect(self, belief: Belief, entry: _Entry) -> tuple[Sequence[float], Sequence[Row], Array | None]:
        """The measurement less its expectation, the rows of the Jacobian, and those of the parameters."""
        time, _, kind, rows, values, _, _ = entry.measurement
        mean, lean, leans = belief.mean, belief.lean, None
        if kind is KIND_GYRO:
            share = 1.0
            if lean is not None:
                share += float(lean.value[SCALE])
                leans = np.zeros((1, len(lean.value)))
                leans[0, SCALE] = mean[OMEGA]
            gyro = (0.0, 0.0, 0.0, 0.0, share, 1.0, 0.0, 0.0)
            return (values[0] - share * mean[OMEGA] - mean[BIAS],), (gyro,), leans
        expected: Sequence[float]
        h: Sequence[Row]
        if kind is KIND_ENCODERS:
            # how far they turn is told by `KIND_TURN`
            if self.turning and time - self._turned_at < STALE and rows == (0, 1):
                return (values[0] - mean[ROLLED],), (ROLLED,), None
            expected, h = encoders(mean, exact=self._exact)
        elif kind is KIND_VELOCITY:
            expected, h = velocities(mean)
        else:
            expected, h, leans = self._seen(belief, entry)
        if len(values) < len(h):
            expected, h = [expected[row] for row in rows], [h[row] for row in rows]
            leans = None if leans is None else leans[list(rows)]
        residual = list(map(sub, values, expected))
        if kind is KIND_POSE and rows[-1] == THETA:
            residual[-1] = wrap_angle(residual[-1])
        return residual, h, leans

    def _seen(self, belief: Belief, entry: _Entry) -> tuple[Sequence[float], Sequence[Row], Array | None]:
        """The pose that a sensor of positions tells, by its mount and clock, and the rows of the Jacobians."""
        measurement = entry.measurement
        x, y, theta, rolled, omega, _, slip, _ = belief.mean
        lean, first = belief.lean, self._places_of.get(measurement.sensor)
        if lean is None or first is None:
            (px, py), by = antenna(belief.mean, measurement.at)
            return (px, py, theta), (*by, THETA), None
        ahead, left, late = lean.value[first : first + 3].tolist()
        late -= entry.late
        v, then, middle = rolled * (1.0 - slip), theta - omega * late, theta - 0.5 * omega * late
        c, s = cos(then), sin(then)
        ahead, left = measurement.at[0] + ahead, measurement.at[1] + left
        at_x, at_y = c * ahead - s * left, s * ahead + c * left
        dx, dy = at_x - late * v * cos(middle), at_y - late * v * sin(middle)
        leans = np.zeros((3, len(lean.value)))
        leans[:, first : first + 3] = (c, -s, omega * at_y - v * c), (s, c, -omega * at_x - v * s), (0.0, 0.0, -omega)
        rows = (1.0, 0.0, -dy, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, dx, 0.0, 0.0, 0.0, 0.0, 0.0)
        return (x + dx, y + dy, then), (*rows, THETA), leans

    # -- start-up without a pose -----------------------------------------------------------------------------------

    def _locate(self, belief: Belief, entry: _Entry) -> Belief:
        """Find the pose in a sensor's frame: with a heading at once, else from several positions."""
        measurement, mean, lean = entry.measurement, belief.mean, belief.lean
        values, sigmas = measurement.values, measurement.sigmas
        (px, py, _), h, leans = self._seen(belief, entry)
        # how the place that it measures leans
        place = None
        if lean is not None:
            place = np.array(h[:2]) @ lean.by
            if leans is not None:
                place -= leans[:2]
        if measurement.rows == (0, 1, 2):
            turn = values[2] - mean[THETA]
            spread = np.diag(np.square(sigmas))
            c, s = cos(turn), sin(turn)
            x, y = values[0] - c * px + s * py, values[1] - s * px - c * py
            found_leans = None
            if lean is not None and place is not None:
                turns = (0.0 if leans is None else leans[2]) - lean.by[THETA]
                away = np.array((py - mean[1], mean[0] - px))
                found_leans = turns, lean.by[:2] - place + away[:, None] * turns
        elif measurement.rows == (0, 1):
            self._pairs.append(((px, py, *values, sigmas[0]), place))
            found = aligned(self._pairs, belief)
            if found is None:
                return belief
            turn, x, y, spread, found_leans = found
        else:
            return belief
        self._base = turned(self._base[0], turn, x, y, spread, found_leans), self._base[1]
        for entry in self._entries:
            entry.belief = turned(entry.belief, turn, x, y, spread, found_leans)
        self._located = True
        self._pairs.clear()
        self.changes.append(f"the pose is known, by '{measurement.sensor}'")
        return turned(belief, turn, x, y, spread, found_leans)

    # -- the estimate ----------------------------------------------------------------------------------------------

    def _as_stated(self, lean: Lean) -> tuple[Array, Array]:
        """By how much the parameters move towards what is stated, and their second moment there.

        Each is as stated, or wrong by its sigma, by the odds of Bayes (R. E. Kass, A. E. Raftery, JASA 90, 1995). The
        mean of both hypotheses is told.
        """
        spread = lean.covariance
        own = np.diag(spread)
        odds = WRONG / (1.0 - WRONG) * np.sqrt(own) / self._parameters
        odds = odds * np.exp(np.minimum(0.5 * lean.value**2 / own, 100.0))
        by = -lean.value / (1.0 + odds)
        return by, spread + np.outer(by, by)

    def _estimate(self, belief: Belief) -> Estimate:
        if belief.lean is not None:
            belief = upright(belief, *self._as_stated(belief.lean))
        x, y, theta, _, omega, bias, slip, _ = belief.mean
        places = [(self._judges[name], frame) for name, frame in self._frames.items()]
        v, told = outside(belief, self._besides.covariance(places))
        return new(Estimate, (x, y, wrap_angle(theta), v, omega, told, bias, slip, self._located))


def _left_out(belief: Belief, entry: _Entry, judge: Judge) -> Belief:
    """The belief without a reading."""
    entry.used = False
    judge.rejected += 1
    return belief
