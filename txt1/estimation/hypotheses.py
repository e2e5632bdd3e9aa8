"""What else may be true: a frame that moves, a robot that was carried, wheels that err, a frame that is still unknown.

Whether the frame of a sensor of positions moves, or the car does otherwise than its wheels tell: both make the sensor
contradict dead reckoning. What a car can do is bounded, though: its wheels slip along their way,
it slides aside a little, the mount and the clock are not quite as stated. So over a window the difference between the
sensor's positions z and the reckoned ones p (both in the room's axes, P from the window's middle) is by hypothesis

    usual  z - p = c + s P + a J P + R(theta) e - tau v
    car    the same, + u M in each piece of the window
    frame  the same as usual, + w t

with J a quarter turn and M the way at 1 m/s, all linear with normal priors: slip s, direction a, lever arm e, clock
tau, another speed u than the wheels tell, as they slip, and the frame's own velocity w. The frame moves where the
likelihood ratio of the two refutes the car, which does not fit, while the frame does: a generalised likelihood ratio
test (A. S. Willsky, H. L. Jones, IEEE TAC 21(1), 1976). The car's speed may be another in each piece, as slip changes.
So only what goes across its way refutes it: on a straight way slip and a frame that moves along it are the same, and
the next curve tells. Where gyro and wheels miss the headings, they err, and nothing is decided. Meanwhile the frame's
probability, by the densities of both hypotheses, weighs the covariance of a pose that follows it: by the way that the
pose has gone otherwise than reckoned since the frame was last likely to stand, and by what slip may miss of that way.

`Besides` has what the covariance that is told has besides the filter's. The filter follows one hypothesis. Where
another one has the pose d away, and is as likely as p, the second moment about the pose of the first is p d d^T more
(Bar-Shalom, Li, Kirubarajan 2001, 1.4.16).

`aligned` finds the frame in which positions are measured, by laying the driven path over them.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Collection, Iterable, Sequence
from itertools import islice
from math import atan2, cos, exp, hypot, sin, sqrt
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np

from txt1.estimation.filter import THETA, TT, XX, YY, Array, Belief, X, Y
from txt1.estimation.judging import FORGOTTEN, OTHER, Judge
from txt1.estimation.sensors import Measurement
from txt1.units import new

# s: a precise sensor tells soon, a GPS of 1 m later
WINDOWS: Final[tuple[float, ...]] = (0.8, 1.6, 3.2)
# s between two readings that are compared
PICKED: Final = 0.1
# readings
READINGS_MIN: Final = 7
# s for which the wheels miss the car's speed by the same
PIECE: Final = 0.2
# s of reckoning
RECKONING_KEPT: Final = 2.0
# s over which slip is averaged, to tell whether it has changed
USUAL_FOR: Final = 10.0
# s, the longest gap between two readings that are compared
PICKS_GAP_MAX: Final = 0.5
# standard deviation of slip when wheels spin
SLIPS: Final = 0.3
# ... and when they do not
USUAL_SLIP: Final = 0.05
# m/s of the car that wheels do not tell: they stand, skid, or are broken
UNTOLD: Final = 0.3
# rad of the direction of motion
ASIDE: Final = 0.01
# s^2/m of the same in curves: tyres slide by lateral acceleration
CORNERING: Final = 0.05
# rad by which gyro or wheels miss a turn within a window
TURNED: Final = 0.015
CLOCK: Final = 0.01  # s
# m by which a mount may be off, at least, when a frame is judged
LEVER: Final = 0.03
# m/s of the frame
FRAME_SPEED: Final = 1.0
# m by which dead reckoning misses besides within a window
RECKONED: Final = 0.004
# chi-square of two numbers at 99.9999 %
REFUTED: Final = 27.6
# standard deviations of a normal number at 99 %
QUANTILE_99: Final = 2.33


class Spot(NamedTuple):
    """Where dead reckoning has the car, in a frame of its own."""

    time: float  # s
    x: float  # m
    y: float  # m
    theta: float  # rad
    # m, the same with the slip that is usual
    usual_x: float
    usual_y: float  # m
    v: float  # m/s


class Reckoning:
    """The way by the wheels' speed and the best yaw rate."""

    def __init__(self) -> None:
        self._spots: deque[Spot] = deque()
        self.slip = 0.0
        """The usual one."""

    def clear(self) -> None:
        """Begin anew: nothing tells how it moved."""
        self._spots.clear()

    def go(self, time: float, dt: float, v: float, omega: float, slip: float, sideways: float) -> None:
        """Go on for dt seconds until `time`, at the wheels' speed (m/s), less slip, and a yaw rate (rad/s).

        `sideways` is how much the car slides outwards in curves, s^2/m, of `filter.predict`.
        """
        spots = self._spots
        self.slip += (slip - self.slip) * (dt / USUAL_FOR if dt < USUAL_FOR else 1.0)
        usual, v = v * (1.0 - self.slip), v * (1.0 - slip)
        if spots and time - dt - spots[-1].time > 0.5 * dt:
            spots.clear()
        if not spots:
            spots.append(Spot(time - dt, 0.0, 0.0, 0.0, 0.0, 0.0, v))
        _, x, y, theta, usual_x, usual_y, _ = spots[-1]
        theta += 0.5 * omega * dt
        course = theta - sideways * abs(v) * omega
        ahead, aside = dt * cos(course), dt * sin(course)
        spots.append(
            new(Spot, (
                time, x + v * ahead, y + v * aside, theta + 0.5 * omega * dt,
                usual_x + usual * ahead, usual_y + usual * aside, v,
            ))
        )  # fmt: skip
        while time - spots[0].time > RECKONING_KEPT:
            spots.popleft()

    @property
    def until(self) -> float:
        """The time that it has reached, s."""
        return self._spots[-1].time if self._spots else -1.0

    def at(self, time: float) -> Spot | None:
        """Where it was; None where that is not known."""
        spots = self._spots
        if not spots or not spots[0].time <= time <= spots[-1].time:
            return None
        place = max(bisect_left(spots, time, key=itemgetter(0)), 1)
        one, two = spots[place - 1], spots[place]
        share = (time - one.time) / max(two.time - one.time, 1e-9)
        x, y, theta, usual_x, usual_y = (a + share * (b - a) for a, b in zip(one[1:6], two[1:6], strict=True))
        return Spot(time, x, y, theta, usual_x, usual_y, two.v)


class _Pick(NamedTuple):
    time: float
    # of the robot by the sensor, m
    x: float
    y: float
    # by the filter, rad
    theta: float
    # of the position
    sigma: float
    sigma_theta: float
    # where the filter has the robot, m
    here: tuple[float, float]
    spot: Spot


class Frame:
    """The frame of one sensor of positions."""

    def __init__(self) -> None:
        self.moves = False
        """Whether it moves."""
        self.probability = 0.0
        """That it does, by the window that makes it most likely."""
        self.lever = LEVER
        """Standard deviation of the sensor's place on the robot, m."""
        self._picks: deque[_Pick] = deque(maxlen=round(WINDOWS[-1] / PICKED) + 2)
        self._waiting: deque[tuple[Measurement, Belief]] = deque(maxlen=100)
        self._last = -1.0
        self._at = 0.0, 0.0
        # the last reading at which it was likely to stand, while it is likely to move
        self._stood: _Pick | None = None
        # s, until when the pose did not follow it
        self._refused = -1.0
        # the highest probability since it stood
        self._most = 0.0
        self.past = 0.0, 0.0, 0.0
        """What it may have pulled the pose by before it was likely to stand: as `pulled`, by the root of the
        probability."""

    def clear(self) -> None:
        """Begin anew, as a reading leapt."""
        self._stands()
        self._picks.clear()
        self._waiting.clear()
        self.probability = 0.0

    def due(self, time: float) -> bool:
        """Whether a reading at this time, s of the run, is long enough after the last one."""
        return time - self._last >= PICKED - 1e-6

    def take(self, measurement: Measurement, belief: Belief) -> None:
        """Take in a position, and the filter's belief there."""
        if measurement.at != self._at:
            # another mount than before would look like a frame that has moved
            self._mount(measurement.at)
        since = measurement.time - self._last
        if since >= PICKED - 1e-6:
            self._last = measurement.time
            fading = exp(-since / FORGOTTEN)
            x, y, sigma = self.past
            self.past = fading * x, fading * y, fading * sigma
            self._waiting.append((measurement, belief))

    def _mount(self, at: tuple[float, float]) -> None:
        """Have the robot's positions by another place of the sensor on it, m."""
        dx, dy = self._at[0] - at[0], self._at[1] - at[1]
        self._at = at
        for place, pick in enumerate(self._picks):
            c, s = cos(pick.theta), sin(pick.theta)
            self._picks[place] = pick._replace(x=pick.x + c * dx - s * dy, y=pick.y + s * dx + c * dy)

    def refuse(self, time: float) -> None:
        """Note that the pose does not follow it until `time`, s of the run."""
        self._stood, self._refused, self._most, self.past = None, time, 0.0, (0.0, 0.0, 0.0)

    def compare(self, reckoning: Reckoning) -> None:
        """Compare the positions with dead reckoning, as far as it goes."""
        more = False
        while self._waiting and self._waiting[0][0].time <= reckoning.until:
            (time, _, _, _, values, sigmas, _), belief = self._waiting.popleft()
            here_x, here_y, theta = belief.mean[:3]
            spot = reckoning.at(time)
            if spot is None or (self._picks and time - self._picks[-1].time > PICKS_GAP_MAX):
                self._stands()
                self._picks.clear()
            if spot is not None:
                c, s = cos(theta), sin(theta)
                ahead, left = self._at
                x, y = values[0] - c * ahead + s * left, values[1] - s * ahead - c * left
                sigma_theta = sqrt(belief.triangle[TT])
                self._picks.append(_Pick(time, x, y, theta, sigmas[0], sigma_theta, (here_x, here_y), spot))
                more = True
        if more:
            told = [self._moves(span) for span in WINDOWS]
            self.moves = any(moves for moves, _ in told)
            self.probability = max(probability for _, probability in told)
            self._most = max(self._most, self.probability)
            if self.probability <= OTHER:
                self._stands()
            elif self._stood is None:
                begin = max(self._picks[-1].time - WINDOWS[0], self._refused)
                self._stood = next((each for each in self._picks if each.time >= begin - 1e-6), None)

    def _stands(self) -> None:
        """Note that it is likely to stand now, wherever it may have moved the pose to before."""
        if self._stood is not None and self._picks:
            (x, y, sigma), chance = self.pulled, sqrt(self._most)
            past_x, past_y, past_sigma = self.past
            self.past = past_x + chance * x, past_y + chance * y, hypot(past_sigma, chance * sigma)
        self._stood, self._most = None, 0.0

    def _moves(self, span: float) -> tuple[bool, float]:
        """Return whether the frame moves, by the last `span` seconds, and its probability from the evidence."""
        all_picks, end = self._picks, self._picks[-1].time if self._picks else 0.0
        first = bisect_left(all_picks, end - span - 1e-6, key=itemgetter(0))
        count = len(all_picks) - first
        if count < READINGS_MIN or end - all_picks[0].time < 0.9 * span or _agrees(all_picks[first], all_picks[-1]):
            return False, 0.0
        picks = list(islice(all_picks, first, None))
        if _misturned(picks):
            return False, OTHER
        times, xs, ys = np.array([each[:3] for each in picks]).T
        spots = np.array([each.spot for each in picks])
        turn = picks[0].theta - picks[0].spot.theta
        c, s = cos(turn), sin(turn)
        px, py = c * spots[:, 1] - s * spots[:, 2], s * spots[:, 1] + c * spots[:, 2]
        xs, ys = xs - px, ys - py
        px, py, times = px - px.mean(), py - py.mean(), times - times.mean()
        headings = turn + spots[:, 3]
        ahead, aside = np.cos(headings), np.sin(headings)
        one, none = np.ones(count), np.zeros(count)
        ways, speeds = _pieces(times, ahead, aside, spots[:, 6])
        rows = np.array([
            [one, none], [none, one], [px, py], [-py, px], [ahead, aside], [-aside, ahead],
            [-ahead * spots[:, 6], -aside * spots[:, 6]], [times, none], [none, times], *ways,
        ]).reshape(9 + len(ways), -1)  # fmt: skip
        turned = abs(spots[-1, 3] - spots[0, 3]) / span
        direction = hypot(ASIDE, picks[0].sigma_theta, CORNERING * turned * float(np.abs(spots[:, 6]).mean()))
        shared = [1e3, 1e3, USUAL_SLIP, direction, self.lever, self.lever, CLOCK]
        noise = hypot(max(each.sigma for each in picks), RECKONED)
        left = np.concatenate((xs - xs.mean(), ys - ys.mean())) / noise
        rows = rows / noise
        frame, frame_unlikely = _misfit(left, rows[:9], [*shared, FRAME_SPEED, FRAME_SPEED])
        slips = [hypot(SLIPS * speed, UNTOLD) for speed in speeds]
        car, car_unlikely = _misfit(left, np.delete(rows, (7, 8), 0), [*shared, *slips])
        free = 2 * count - 2
        # Wilson and Hilferty's quantile of chi-square
        limit = free * (1.0 - 2.0 / (9.0 * free) + QUANTILE_99 * sqrt(2.0 / (9.0 * free))) ** 3
        odds = OTHER / (1.0 - OTHER) * exp(min(0.5 * (car_unlikely - frame_unlikely), 100.0))
        return car - frame > REFUTED and frame < limit < car, odds / (1.0 + odds)

    @property
    def pulled(self) -> tuple[float, float, float]:
        """How far (m) the pose went otherwise than reckoned since the frame stood, and the reckoned way's sigma, m.

        Zeros within noise; all three while it is not likely to move.
        """
        one = self._stood
        if one is None:
            return 0.0, 0.0, 0.0
        two = self._picks[-1]
        way_x, way_y = _turned(one, two.spot.usual_x - one.spot.usual_x, two.spot.usual_y - one.spot.usual_y)
        dx, dy = two.here[0] - one.here[0] - way_x, two.here[1] - one.here[1] - way_y
        sigma = USUAL_SLIP * hypot(way_x, way_y)
        return (dx, dy, sigma) if hypot(dx, dy) > _noise(one, two) else (0.0, 0.0, sigma)


def _turned(one: _Pick, dx: float, dy: float) -> tuple[float, float]:
    """A reckoned way in the room's axes, m."""
    turn = one.theta - one.spot.theta
    c, s = cos(turn), sin(turn)
    return c * dx - s * dy, s * dx + c * dy


def _noise(one: _Pick, two: _Pick) -> float:
    return 3.0 * hypot(one.sigma, two.sigma, RECKONED)


def _misturned(picks: list[_Pick]) -> bool:
    """Whether the reckoned turn is refuted by the headings: then a gyro or wheels err, as a frame does not turn."""
    apart = [each.theta - each.spot.theta for each in picks]
    return max(apart) - min(apart) > TURNED + 3.0 * sqrt(2.0) * picks[-1].sigma_theta


def _agrees(one: _Pick, two: _Pick) -> bool:
    """Whether the way between two readings is as reckoned, but for noise: then there is nothing to explain."""
    dx, dy = _turned(one, two.spot.x - one.spot.x, two.spot.y - one.spot.y)
    return hypot(two.x - one.x - dx, two.y - one.y - dy) < _noise(one, two)


def _pieces(times: Array, ahead: Array, aside: Array, speeds: Array) -> tuple[list[list[Array]], list[float]]:
    """The way within each piece of a window at 1 m/s, by the heading's cosine and sine, and the wheels' speed there."""
    which = ((times - times[0] - 1e-6) / PIECE).astype(int)[1:]
    spans, middled = np.diff(times), [0.5 * (each[1:] + each[:-1]) for each in (ahead, aside)]
    ways, told = [], []
    for piece in range(int(which[-1]) + 1):
        inside = which == piece
        ways.append([np.concatenate(((0.0,), np.cumsum(each * spans * inside))) for each in middled])
        told.append(float(np.abs(speeds[1:][inside]).mean()) if inside.any() else 0.0)
    return ways, told


def _misfit(left: Array, rows: Array, priors: list[float]) -> tuple[float, float]:
    """The square of a Mahalanobis distance, of numbers of variance 1 from a linear model with priors, and a density.

    The density is -2 times its logarithm, without the terms that all models share. It is the distance plus the
    logarithm of the determinant of the covariance: a model pays for its free parameters.
    """
    side, sigmas = rows @ left, np.array(priors)
    normal = rows @ rows.T + np.diag(sigmas**-2.0)
    distance = float(left @ left) - float(side @ np.linalg.solve(normal, side))
    return distance, distance + float(np.linalg.slogdet(normal)[1]) + 2.0 * float(np.log(sigmas).sum())


class Besides:
    """The hypotheses that the filter does not follow."""

    def __init__(self) -> None:
        # m, m, rad by which a jump may be the robot's
        self._carried = 0.0, 0.0, 0.0
        # m, m, rad by which an absolute sensor has overruled dead reckoning
        self._overruled = 0.0, 0.0, 0.0
        # m in x and y by which the way may be longer than the car's, as speed and heading may be off
        self._way = 0.0, 0.0

    def missed(self, rows: Sequence[int], residual: Sequence[float]) -> None:
        """Note a reading that leapt by this in these rows of the pose, m or rad: the robot may have been carried."""
        by = dict(zip(rows, residual, strict=True))
        self._carried = by.get(X, 0.0), by.get(Y, 0.0), by.get(THETA, 0.0)

    def overrule(self, before: Belief, after: Belief) -> None:
        """Note that an absolute sensor has overruled dead reckoning, which may be right."""
        (x, y, turn), one, two = self._overruled, before.mean, after.mean
        self._overruled = x + two[0] - one[0], y + two[1] - one[1], turn + two[2] - one[2]

    def fade(self, dt: float) -> None:
        """Forget, in dt seconds, by how much dead reckoning was overruled."""
        (x, y, turn), fading = self._overruled, exp(-dt / FORGOTTEN)
        self._overruled = x * fading, y * fading, turn * fading

    def drive(self, theta: float, speed: float, dt: float) -> None:
        """Note that the speed may have been off by `speed` m/s for dt seconds, so that the pose is off by the way."""
        x, y = self._way
        self._way = x + speed * dt * cos(theta), y + speed * dt * sin(theta)

    def place(self, before: Belief, after: Belief) -> None:
        """Note a position that was taken in: it takes away of the way's error what it takes of the variance."""
        self._carried = 0.0, 0.0, 0.0
        x, y = self._way
        if x or y:
            self._way = x * after.triangle[XX] / before.triangle[XX], y * after.triangle[YY] / before.triangle[YY]

    def covariance(self, places: Iterable[tuple[Judge, Frame]]) -> tuple[float, float, float, float]:
        """Variances of x, of x and y, of y (m^2), and of theta (rad^2), that all of them add.

        `places` are the judges of the sensors that tell positions, and their frames.
        """
        xx = xy = yy = tt = 0.0
        others = [(OTHER, self._carried), (OTHER, self._overruled), (1.0, (*self._way, 0.0))]
        for judge, frame in places:
            others.append((1.0, (*judge.lasting(), 0.0)))
            for chance, (x, y, sigma) in ((1.0, frame.past), (frame.probability, frame.pulled)):
                others.append((chance, (x, y, 0.0)))
                xx, yy = xx + chance * sigma * sigma, yy + chance * sigma * sigma
        for chance, (x, y, turn) in others:
            xx, xy = xx + chance * x * x, xy + chance * x * y
            yy, tt = yy + chance * y * y, tt + chance * turn * turn
        return xx, xy, yy, tt


def bent(variance: float) -> float:
    """The share by which a way is shorter along a heading of this variance, rad^2: the root of its second moment.

    A belief has what goes across the way, as it is linear in the heading. Along it the way is longer than the car's by
    1 - cos of the error: places that are as likely lie on an arc.
    """
    mean, square = 1.0 - exp(-0.5 * variance), 1.0 - exp(-variance)
    return sqrt(mean * mean + 0.5 * square * square)


# rad, the standard deviation at which a heading found from positions is good enough
ALIGNED: Final = 0.25

# pairs that a frame is found from
PAIRS_MIN: Final = 5
# sigma from where a fit has it, beyond which a position is left out: 99.9 % of two numbers
LEFT_OUT_SIGMA: Final = 3.7


def aligned(
    pairs: Collection[tuple[tuple[float, ...], Array | None]], belief: Belief
) -> tuple[float, float, float, Array, tuple[Array, Array] | None] | None:
    """The turn (rad) and move (m) that bring positions p onto measured ones z, their covariance where the robot is now.

    The last is how the turn and the robot's place before it lean, of `filter.turned`. None: too vague.

    Least squares in closed form, S. Umeyama, PAMI 13(4), 1991, in the plane and without scale: with both centred,
    turn = atan2(sum p x z, sum p . z). Its variance is sigma^2 / sum |p|^2, that of the centre sigma^2 / n. Each pair
    is p, z and sigma, and how p leans. Pairs that are left more than `LEFT_OUT_SIGMA` sigma away are left
    out, the farthest first (trimmed least squares, P. J. Rousseeuw, JASA 79, 1984).
    """
    kept, used = np.array([numbers for numbers, _ in pairs]), np.arange(len(pairs))
    while len(kept) >= PAIRS_MIN:
        cx, cy, dx, dy, _ = middle = kept.mean(axis=0)
        px, py, zx, zy, _ = (kept - middle).T
        turn = atan2(float(px @ zy - py @ zx), float(px @ zx + py @ zy))
        c, s = cos(turn), sin(turn)
        sigmas = kept[:, 4]
        left = np.hypot(zx - c * px + s * py, zy - s * px - c * py) / sigmas
        worst = int(left.argmax())
        if left[worst] > LEFT_OUT_SIGMA:
            kept, used = np.delete(kept, worst, axis=0), np.delete(used, worst)
            continue
        spread, variance = float(px @ px + py @ py), float(np.mean(sigmas**2))
        if spread * ALIGNED**2 < variance:
            return None
        lean, how = belief.lean, None
        x, y = belief.mean[X] - cx, belief.mean[Y] - cy
        if lean is not None:
            by = np.array([leans for _, leans in pairs])[used]
            turns = (py @ by[:, 0] - px @ by[:, 1]) / spread
            if turns @ lean.covariance @ turns + variance / spread > ALIGNED**2:
                return None
            how = turns, lean.by[:2] - by.mean(axis=0) + np.array((-y, x))[:, None] * turns
        j = np.array([[1.0, 0.0, -s * x - c * y], [0.0, 1.0, c * x - s * y], [0.0, 0.0, 1.0]])
        known = j @ np.diag((variance / len(kept), variance / len(kept), variance / spread)) @ j.T
        return turn, float(dx - c * cx + s * cy), float(dy - s * cx - c * cy), known, how
    return None
