"""An extended Kalman filter for a car: pose, velocities, the gyro's bias and the wheels' slip.

Pure functions over arrays. "BLK" is Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking
and Navigation* (Wiley, 2001):

    x' = f(x, u),  P' = F P F^T + Q                                  BLK 10.3.2
    S = H P H^T + R,  K = P H^T S^-1,  x' = x + K (z - h(x))         BLK 10.3.2
    P' = P - K S K^T                                                 BLK (5.2.3-13)

Both are taken by the root of S: with S = L L^T, W = P H^T L^-T and the misses y = L^-1 (z - h(x)), which are
independent and of variance 1,

    x' = x + W y,  P' = P - W W^T,  NIS = y^T y

W W^T is symmetric whatever is rounded, the root has half the digits of S to lose, and a step takes seven products.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf, sin, sqrt
from operator import mul
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

X, Y, THETA, ROLLED, OMEGA, BIAS, SLIP = range(7)
"""Places in the state: pose (m, rad), the wheels' speed (m/s), yaw rate (rad/s), the gyro's bias (rad/s), slip.

Slip is the share of the wheels' way that the ground does not see, because they slip or are smaller than believed: the
car's speed is (1 - slip) of the wheels'. That speed is not in the state itself: then the encoders would seem to tell
something of the slip whenever it changes, which alone they cannot.
"""
SIZE: Final = 7
IDENTITY: Final = np.eye(SIZE)
CRAWL: Final = 0.05  # m/s below which the steering angle is not told from speed and yaw rate
TAN_MAX: Final = 0.6  # tangent of the steering angle beyond which it is noise: full lock is 0.30


class Belief(NamedTuple):
    """A state and its covariance."""

    mean: Array  # shape (7,)
    covariance: Array  # shape (7, 7)


@dataclass(frozen=True, slots=True)
class Drift:
    """How much the state may change by itself in a second: standard deviations of random walks."""

    position: float = 0.002  # m: sideways slip
    heading: float = 0.001  # rad
    speed: float = 0.25  # m/s: the motors and the floor
    yaw_rate: float = 0.35  # rad/s: beyond the steering's own
    bias: float = 0.0002  # rad/s of the gyro
    slip: float = 0.002  # of the wheels

    def density(self) -> Array:
        """The covariance of a second, shape (7, 7)."""
        each = self.position, self.position, self.heading, self.speed, self.yaw_rate, self.bias, self.slip
        return np.diag(np.square(each))


def predict(belief: Belief, dt: float, density: Array, bend: float = 0.0) -> Belief:
    """The belief dt seconds later, on the arc of its speed and yaw rate, thesis (2.2).

    Args:
        belief: now.
        dt: s.
        density: covariance that a second adds, shape (7, 7), of `Drift.density`.
        bend: change of the steering's curvature meanwhile, 1/m: the yaw rate changes by speed times that, (2.12).

    """
    mean, covariance = belief
    _, _, theta, rolled, omega, _, slip = mean.tolist()
    grip = 1.0 - slip
    half = 0.5 * omega * dt
    ratio = sin(half) / half if abs(half) > 1e-4 else 1.0  # the chord's length over the arc's
    c, s = dt * ratio * cos(theta + half), dt * ratio * sin(theta + half)
    v = rolled * grip
    after = mean.copy()
    after[X] += v * c
    after[Y] += v * s
    after[THETA] = theta + omega * dt
    after[OMEGA] = omega + v * bend
    f = IDENTITY.copy()
    f[X, THETA], f[Y, THETA] = -v * s, v * c
    f[X, OMEGA], f[Y, OMEGA] = -0.5 * dt * v * s, 0.5 * dt * v * c
    f[X, ROLLED], f[Y, ROLLED] = grip * c, grip * s
    f[X, SLIP], f[Y, SLIP] = -rolled * c, -rolled * s
    f[THETA, OMEGA] = dt
    if bend:
        f[OMEGA, ROLLED], f[OMEGA, SLIP] = grip * bend, -rolled * bend
    grown = f.dot(covariance).dot(f.T)
    return Belief(after, 0.5 * (grown + grown.T) + density * dt)  # rounding leaves it a little askew


def update(
    belief: Belief, residual: Array | Sequence[float], h: Array, r: Array, gate: float = inf
) -> tuple[Belief, float, Sequence[float]]:
    """The belief with a measurement taken in, the square of its Mahalanobis distance (NIS), and its misses.

    The misses are the residual's parts in standard deviations, each less what those before it already say.

    Args:
        belief: before.
        residual: measurement less expectation, z - h(x), m numbers, m at most 3.
        h: Jacobian of the expectation, shape (m, 7).
        r: covariance of the measurement, shape (m, m).
        gate: largest NIS that is believed; beyond it the belief comes back as it was.

    """
    mean, covariance = belief
    cross = covariance.dot(h.T)
    root = whitener((h.dot(cross) + r).tolist())
    misses = [sum(map(mul, row, residual)) for row in root]
    nis = sum(map(mul, misses, misses))
    if not nis <= gate:  # also when it is not a number
        return belief, nis, misses
    w = cross.dot(np.array(root).T)
    return Belief(mean + w.dot(misses), covariance - w.dot(w.T)), nis, misses


def whitener(s: list[list[float]]) -> Sequence[Sequence[float]]:
    """The inverse of the lower root L of a covariance S = L L^T of up to three numbers; numpy takes longer.

    It makes numbers of that covariance independent and of variance 1.
    """
    a = 1.0 / sqrt(s[0][0])
    if len(s) == 1:
        return ((a,),)
    b = s[1][0] * a
    c = 1.0 / sqrt(s[1][1] - b * b)
    if len(s) == 2:
        return (a, 0.0), (-a * b * c, c)
    d = s[2][0] * a
    e = (s[2][1] - d * b) * c
    f = 1.0 / sqrt(s[2][2] - d * d - e * e)
    return (a, 0.0, 0.0), (-a * b * c, c, 0.0), ((b * e * c - d) * a * f, -e * c * f, f)


def encoders(mean: Array, wheelbase: float) -> tuple[tuple[float, float], Array]:
    """Speed and yaw rate that the encoders tell in a state, and the Jacobian, shape (2, 7).

    They sit on the steered front wheels, at the angle phi with tan(phi) = L omega / (2 v), (2.12): these roll
    1 / cos(phi) of the centre's path, and tell cos(phi) of the turn.
    """
    _, _, _, rolled, omega, _, slip = mean.tolist()
    grip = 1.0 - slip
    tangent = 0.5 * wheelbase * omega / (rolled * grip) if abs(rolled) > CRAWL else 0.0
    if abs(tangent) > TAN_MAX:
        tangent = 0.0
    stretch = sqrt(1.0 + tangent * tangent)
    share = (tangent / stretch) ** 2
    turning = omega / (grip * stretch)
    h = np.zeros((2, SIZE))
    h[0, ROLLED], h[0, SLIP] = stretch * (1.0 - share), rolled * stretch * share / grip
    h[0, OMEGA] = 0.5 * wheelbase * tangent / (grip * stretch)
    h[1, OMEGA], h[1, SLIP] = (1.0 - share) / (grip * stretch), turning * (1.0 - share) / grip
    h[1, ROLLED] = turning * share / rolled if share else 0.0
    return (rolled * stretch, turning), h


def velocities(mean: Array) -> tuple[tuple[float, float], Array]:
    """Speed and yaw rate, and the Jacobian, shape (2, 7)."""
    _, _, _, rolled, omega, _, slip = mean.tolist()
    grip = 1.0 - slip
    h = np.zeros((2, SIZE))
    h[0, ROLLED], h[0, SLIP], h[1, OMEGA] = grip, -rolled, 1.0
    return (rolled * grip, omega), h


def antenna(mean: Array, at: tuple[float, float]) -> tuple[tuple[float, float], Array]:
    """Where a receiver at a place on the robot (x forward, y left, m) is, and the Jacobian, shape (2, 7)."""
    x, y, theta = mean[:3].tolist()
    c, s = cos(theta), sin(theta)
    dx, dy = at[0] * c - at[1] * s, at[0] * s + at[1] * c
    h = np.zeros((2, SIZE))
    h[0, X] = h[1, Y] = 1.0
    h[0, THETA], h[1, THETA] = -dy, dx
    return (x + dx, y + dy), h


def picked(*places: int) -> Array:
    """The Jacobian of a measurement of these parts of the state themselves, shape (m, 7)."""
    return IDENTITY[list(places)]


def turned(belief: Belief, turn: float, x: float, y: float, spread: Array) -> Belief:
    """The belief in another frame: turned by `turn` rad about the origin, then moved by (x, y) m.

    `spread` is the covariance of x, y and turn, shape (3, 3), of the frame where the robot is now.
    """
    mean, covariance = belief
    c, s = cos(turn), sin(turn)
    after = mean.copy()
    after[X], after[Y] = x + c * mean[X] - s * mean[Y], y + s * mean[X] + c * mean[Y]
    after[THETA] += turn
    f = IDENTITY.copy()
    f[:2, :2] = (c, -s), (s, c)
    rotated = f.dot(covariance).dot(f.T)
    rotated[:3, :3] += spread
    return Belief(after, rotated)
