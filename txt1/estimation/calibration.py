"""Errors of the mounts, the clocks and the scales of sensors, learned while driving.

A sensor that tells positions sits somewhere on the robot (its lever arm l), and its readings are older than they say by
tau. The wheels' way is too long by the slip s, and a gyro reads (1 + g) omega + b. In curves the car slides outwards:
its way is turned by -k abs(v) omega. From one position to another, half a second later, the robot itself knows how it
moved: d (m, in the frame of the first, with each piece of it turned so) and a turn. So

    R(-theta_A) (z_B - z_A) = (1 - s) d + (R(turn) - I) l - tau (R(turn) v_B - v_A)
    theta_B - theta_A = (turn - b T) (1 - g) - tau (omega_B - omega_A)

which is linear in (l, tau, s, g, b, k) for small errors: a Kalman filter of these seven beside the robot's own, as of
B. Friedland, *Treatment of bias in recursive filtering*, IEEE TAC 14(4), 1969. An error that the drive does not show
keeps its first standard deviation: a lever arm shows in turns, a clock where the speed changes, and sliding outwards in
curves at two speeds. Without k a car that slides looks like a lever arm that points backwards. A lever arm to the left
looks like slip that is another in each curve; so slip may walk as fast as from one manoeuvre to the next.

A heading that the sensor tells is late as well. So the axes in which z_B - z_A is seen are turned by -tau omega_A.

Two hypotheses compete: a stated value is right, or it is wrong by about `START`. The odds of Bayes judge them (R. E.
Kass, A. E. Raftery, JASA 90, 1995, with normal priors). The stated value is used until its error is `SURE`, and worth a
correction; models of cars are wrong by less than that. The estimate tells what is left to doubt.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from math import cos, exp, hypot, inf, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from txt1.estimation.filter import OMEGA as TURNING
from txt1.estimation.filter import ROLLED, SLIP, THETA, Array, Drift, State
from txt1.estimation.sensors import Measurement
from txt1.model.kinematics import wrap_angle

# s between two positions that are compared
SEGMENT: Final = 0.5
# s; after a longer gap a comparison begins anew
LONGEST: Final = 1.5
# cycles
KEPT: Final = 150
# s, the longest between two readings of a gyro
GAP: Final = 0.1
LX, LY, TAU, SLIPPED, SCALE, BIAS, SIDEWAYS = range(7)
START: Final = np.array([0.3, 0.3, 0.05, 0.05, 0.01, 0.02, Drift().sideways]) ** 2
"""Variances at the start: m, m, s, 1, 1, rad/s, s^2/m; of a place on the robot where it is wrong."""
# by how many standard deviations of a tape measure a place is off that was measured from another point, or to the other
# side
MISTAKEN: Final = 10.0
# standard deviation of a slip that has changed, as it does in a second
CHANGED: Final = 0.1
WALK: Final = np.array([1e-5, 1e-5, 1e-5, hypot(Drift().slip, CHANGED), 1e-5, Drift().bias, 1e-4]) ** 2
"""Variances that a second adds; the bias's is the filter's."""
# slip beyond which it is the wheels that err: it changes with each way by its own size, and tells of no mount
ERR: Final = 0.25
# m by which the wheels miss the way after 1 s
ALONG: Final = 0.004
# m by which the robot slides sideways in 1 s
ACROSS: Final = 0.003
# rad, of the heading in which a way begins
AIMED: Final = 0.002
# rad by which a gyro's noise has turned after 1 s
GYRO: Final = 0.0006
# s by which its readings are older than they say: anything up to their period
GYRO_CLOCK: Final = 0.01 / sqrt(12.0)
# share of a turn by which the wheels miss it
BY_WHEELS: Final = 0.02
# chi-square of three numbers at 95 %, beyond which the slip has changed
SUSPECT: Final = 7.815
# the same at 99.9 %
GATE: Final = 16.3
# probability that a stated value is wrong, before anything was measured
WRONG: Final = 0.1
SURE: Final = 0.999
# smaller corrections are not made
WORTH_SCALE: Final = 0.003
CORRECTED: Final = {"x": (LX, 0.005), "y": (LY, 0.005), "delay": (TAU, 0.004), "scale": (SCALE, WORTH_SCALE)}
"""By the names of `Corrections`: the place, and below what no correction is made, m, m, s and 1."""


class Calibrated(NamedTuple):
    """A quantity with its standard deviation."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Corrections:
    """Corrections of a sensor's settings; zeros until the settings are refuted."""

    # m further ahead
    x: float = 0.0
    # m further to the left
    y: float = 0.0
    # s that its readings are older
    delay: float = 0.0
    # of the gyro, less 1
    scale: float = 0.0


class Calibration:
    """The calibration of one sensor that tells positions, and of the gyro and wheels beside it.

    Args:
        lever_sigma: standard deviation of its place on the robot as stated, m.
        delay_sigma: of its delay, s.

    """

    def __init__(self, lever_sigma: float = 0.03, delay_sigma: float = 0.05) -> None:
        self.corrections = Corrections()
        self.mean: Array = np.zeros(START.size)
        self.start: Array = START.copy()
        """Variances at the start."""
        self.start[[LX, LY]] = (MISTAKEN * lever_sigma) ** 2
        self.start[TAU] = delay_sigma**2
        self.covariance: Array = np.diag(self.start)
        # m^2
        self._tape = lever_sigma**2
        self.sideways = Calibrated(0.0, Drift().sideways)
        """How much the car slides outwards in curves, s^2/m, of `filter.predict`."""
        self.segments = 0
        self.heard = -inf
        """When its newest reading was taken, by its own clock, s of the run."""
        # s, the shortest from a reading, by its own clock, to when it had come
        self._shortest = inf
        # end, length, speed, yaw rate
        self._cycles: deque[tuple[float, float, float, float]] = deque(maxlen=KEPT)
        # positions, and the headings that the filter has there, rad
        self._waiting: deque[tuple[Measurement, float]] = deque(maxlen=KEPT)
        self._first: tuple[Measurement, float] | None = None
        self._mount = (0.0, 0.0)
        self._time = 0.0
        self._left = self._left_to_doubt()

    def cycle(
        self, now: float, end: float, dt: float, v: float, omega: float, gyro: deque[tuple[float, float]]
    ) -> bool:
        """Take in a cycle: now, end and length (s), the wheels' speed and yaw rate (m/s, rad/s), the gyro's readings.

        Return whether two positions were compared.
        """
        if 0.0 <= now - self.heard < self._shortest:
            self._shortest = now - self.heard
        self._cycles.append((end, dt, v, omega))
        waiting = self._waiting
        if not waiting or waiting[0][0].time > end or (gyro and gyro[-1][0] < waiting[0][0].time):
            return False
        place, first = waiting.popleft(), self._first
        if first is not None:
            self._compare(*first, place[0], gyro)
        self._first = place
        return first is not None

    def place(self, measurement: Measurement, theta: float) -> None:
        """Take in a position, and the heading that the filter has there, rad."""
        last = self._waiting[-1] if self._waiting else self._first
        if last is not None and measurement.time - last[0].time < SEGMENT - 1e-6:
            return
        self._mount = measurement.at[0] - self.corrections.x, measurement.at[1] - self.corrections.y
        self._waiting.append((measurement, theta))

    def learned(self, name: str) -> Calibrated:
        """A quantity beyond what is stated.

        "x", "y" of the mount (m), "delay" (s), "slip", "scale", "bias" of the gyro (rad/s), and "sideways" (s^2/m).
        """
        place = ("x", "y", "delay", "slip", "scale", "bias", "sideways").index(name)
        return Calibrated(float(self.mean[place]), sqrt(float(self.covariance[place, place])))

    @property
    def mount_variance(self) -> float:
        """The variance that an unknown mount leaves of the pose, m^2."""
        along, _, across, _ = self._left
        return along + across

    def doubt(self, mean: State) -> tuple[float, float, float, float]:
        """Variances (x, x and y, y, theta) of the pose, as mount and clock may be other than they are taken for."""
        a, b, d, time = self._left
        c, s, v = cos(mean[THETA]), sin(mean[THETA]), mean[ROLLED] * (1.0 - mean[SLIP])
        a += time * v * v
        turning = time * mean[TURNING] ** 2
        return (
            c * c * a - 2.0 * c * s * b + s * s * d, c * s * (a - d) + (c * c - s * s) * b,
            s * s * a + 2.0 * c * s * b + c * c * d, turning,
        )  # fmt: skip

    def _compare(self, one: Measurement, theta: float, two: Measurement, gyro: deque[tuple[float, float]]) -> None:
        """Compare the motion between two positions with dead reckoning; the filter's heading at the first is theta."""
        begin, end = one.time, two.time
        span = end - begin
        cycles = np.array([each for each in self._cycles if each[0] > begin - 0.1 and each[0] - each[1] < end])
        if span > LONGEST or len(cycles) < 3:
            return
        ends, lengths, speeds, turns = cycles.T
        begins = ends - lengths
        if begins[0] > begin or ends[-1] < end or np.abs(begins[1:] - ends[:-1]).max() > GAP:
            return
        middles = 0.5 * (begins + ends)
        near = [each for each in gyro if begin - GAP < each[0] < end + GAP]
        by_gyro = len(near) > 2 and all(b[0] - a[0] < GAP for a, b in pairwise(near))
        if by_gyro:
            times, rates = np.array(near).T
            turns = np.interp(middles, times, rates)
        inside = np.clip(np.minimum(ends, end) - np.maximum(begins, begin), 0.0, None)
        rates_now = (turns - self.mean[BIAS]) * (1.0 - self.mean[SCALE]) if by_gyro else turns
        angles = np.cumsum(rates_now * inside)
        headings = angles - 0.5 * rates_now * inside
        grip = 1.0 - self.mean[SLIPPED]
        way = speeds * inside
        pushed = np.abs(speeds) * rates_now
        courses = headings - self.mean[SIDEWAYS] * pushed
        ahead, aside = np.cos(courses), np.sin(courses)
        dx, dy = float(way @ ahead), float(way @ aside)
        side_x, side_y = grip * float((way * pushed) @ aside), -grip * float((way * pushed) @ ahead)
        turn = float(angles[-1])
        c, s = cos(turn), sin(turn)
        v_a, v_b = (float(np.interp(at, middles, speeds)) * grip for at in (begin, end))
        w_a, w_b = (float(np.interp(at, middles, rates_now)) for at in (begin, end))
        # what is estimated is the whole delay, though a part of it is corrected already
        tau = self.mean[TAU] - self.corrections.delay
        lx, ly = self._mount[0] + self.mean[LX], self._mount[1] + self.mean[LY]
        ca, sa = cos(theta), sin(theta)
        zx, zy = two.values[0] - one.values[0], two.values[1] - one.values[1]
        zx, zy = ca * zx + sa * zy, ca * zy - sa * zx
        tau_x, tau_y = -(c * v_b - v_a), -s * v_b
        if len(one.values) > 2:
            # so is the heading that it told
            tau_x, tau_y = tau_x - w_a * zy, tau_y + w_a * zx
        residual = [
            zx - grip * dx - (c - 1.0) * lx + s * ly - tau * tau_x,
            zy - grip * dy - s * lx - (c - 1.0) * ly - tau * tau_y,
        ]
        rows = [
            [c - 1.0, -s, tau_x, -dx, 0.0, 0.0, side_x],
            [s, c - 1.0, tau_y, -dy, 0.0, 0.0, side_y],
        ]
        noise = one.sigmas[0] ** 2 + two.sigmas[0] ** 2
        way_length = hypot(dx, dy)
        # forward and sideways as they are at the first position, which is near enough
        variances = [noise + ALONG**2 * span + (0.003 * way_length) ** 2, noise + ACROSS**2 * span]
        variances[1] += (AIMED * way_length) ** 2
        if by_gyro and len(one.values) > 2 and len(two.values) > 2:
            residual.append(wrap_angle(two.values[2] - one.values[2] - turn) + tau * (w_b - w_a))
            rows.append([0.0, 0.0, -(w_b - w_a), 0.0, -turn, -span, 0.0])
            variances.append(one.sigmas[2] ** 2 + two.sigmas[2] ** 2 + GYRO**2 * span + (GYRO_CLOCK * (w_b - w_a)) ** 2)
        elif not by_gyro:
            variances[1] += (BY_WHEELS * turn * way_length) ** 2
        self._absorb(np.array(residual), np.array(rows), np.diag(variances), end)

    def _absorb(self, residual: Array, rows: Array, noise: Array, time: float) -> None:
        dt = max(0.0, min(time - self._time, LONGEST))
        p = self.covariance + np.diag(WALK) * dt
        if abs(self.mean[SLIPPED]) > ERR:
            p[SLIPPED, SLIPPED] += self.mean[SLIPPED] ** 2
        self._time = time
        s = rows @ p @ rows.T + noise
        if float(residual @ np.linalg.solve(s, residual)) > SUSPECT:
            p[SLIPPED, SLIPPED] += CHANGED**2
            s = rows @ p @ rows.T + noise
            nis = float(residual @ np.linalg.solve(s, residual))
            if nis > GATE:
                s = s + noise * (nis / GATE)
                noise = noise * (1.0 + nis / GATE)
        gain = np.linalg.solve(s, rows @ p).T
        self.mean = self.mean + gain @ residual
        left = np.eye(START.size) - gain @ rows
        # Joseph's form, which stays positive
        self.covariance = left @ p @ left.T + gain @ noise @ gain.T
        self.segments += 1
        self.sideways = self.learned("sideways")
        self._decide()

    def _decide(self) -> None:
        """Correct the mount, the clock and the gyro's scale, each where it is refuted."""
        right = {}
        for name, (place, worth) in CORRECTED.items():
            value, wrong = float(self.mean[place]), self._wrong(place)
            refuted = getattr(self.corrections, name) or (wrong > SURE and abs(value) > worth)
            right[name] = value if refuted else 0.0
        # no reading was taken after it had come
        right["delay"] = max(right["delay"], -self._shortest)
        self.corrections = Corrections(**right)
        self._left = self._left_to_doubt()

    def _wrong(self, place: int) -> float:
        return probability(float(self.mean[place]), float(self.covariance[place, place]), float(self.start[place]))

    def _left_to_doubt(self) -> tuple[float, float, float, float]:
        """Return second moments of the remaining errors: lever arm (along, both, across; m^2), clock (s^2).

        Those of the lever arm are of a consider parameter (S. F. Schmidt): what is told apart from slip so slowly may
        be wrong for long. Those of the clock, which shows at once, are of both hypotheses.
        """
        used, p = self.corrections, self.covariance
        late = self.mean[TAU] - used.delay
        clock = 1.0 if used.delay else self._wrong(TAU)
        along, chance_x = self._mount_doubt(LX, used.x)
        across, chance_y = self._mount_doubt(LY, used.y)
        left_x, left_y = self.mean[LX] - used.x, self.mean[LY] - used.y
        both = sqrt(chance_x * chance_y) * float(p[LX, LY] + left_x * left_y)
        return along, both, across, clock * float(p[TAU, TAU] + late * late)

    def _mount_doubt(self, place: int, used: float) -> tuple[float, float]:
        """The second moment of a lever arm about the one that is used, m^2, and the probability that it is wrong.

        A stated one is either mistaken, or right but for what a tape measure misses, of which the drive tells, too.
        """
        value, variance = float(self.mean[place]), float(self.covariance[place, place])
        if used:
            return variance + (value - used) ** 2, 1.0
        wrong = self._wrong(place)
        # without the prior of one that is mistaken
        told = 1.0 / max(1.0 / variance - 1.0 / float(self.start[place]), 1e-9)
        share = self._tape / (self._tape + told)
        right = share * told + (share * value) ** 2
        return wrong * (variance + value * value) + (1.0 - wrong) * right, wrong


def probability(value: float, variance: float, before: float) -> float:
    """The probability that a stated value is wrong, by its error, the variance of that, and the one before all."""
    exponent = 0.5 * value * value / variance
    odds = WRONG / (1.0 - WRONG) * sqrt(variance / before) * exp(min(exponent, 100.0))
    return odds / (1.0 + odds)
