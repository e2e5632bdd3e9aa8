"""A plain extended Kalman filter to compare the robot's with: seven states, and no judge of its sensors.

The state is x, y, theta (m, rad), speed v (m/s), yaw rate omega (rad/s), the gyro's bias (rad/s) and the wheels' scale.
Its readings are

    wheels  scale v,  scale omega        gyro  omega + bias
    GPS  (x, y) + R(theta) r             motion capture  x, y, theta

The only reading that it leaves out is a GPS fix beyond chi-square 13.8 (99.9 % of two numbers). A late reading is put
in its place by its time, and everything since then is computed again. Equations: Bar-Shalom, Li, Kirubarajan,
*Estimation with Applications to Tracking and Navigation* (Wiley, 2001), 10.3.2.
"""

from bisect import bisect_right
from math import cos, sin
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.model.kinematics import wrap_angle

Array = NDArray[np.float64]

GATE: Final = 13.8  # chi-square of two numbers at 99.9 %
HORIZON: Final = 0.5  # s that a reading may be late
Q: Final = np.array([1e-6, 1e-6, 1e-6, 1.0, 20.0, 1e-8, 1e-5])  # variance that a second adds to each state
START: Final = np.array([1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.01, 0.05]) ** 2
SIGMAS: Final = {
    "wheels": np.array([0.015, 0.1]),
    "imu": np.array([0.006]),
    "gps": np.array([1.0, 1.0]),
    "vicon": np.array([0.002, 0.002, 0.003]),
}
"""Standard deviations of the readings: m/s and rad/s; rad/s; m; m and rad."""


class Told(NamedTuple):
    """A reading."""

    time: float  # s
    sensor: str
    values: Array
    at: float = 0.0  # m that it sits ahead of the pose


class PlainFilter:
    """The filter, with `pose` (x, y, theta) known at the start."""

    def __init__(self, pose: tuple[float, float, float]) -> None:
        mean = np.array([*pose, 0.0, 0.0, 0.0, 1.0])
        self._readings: list[Told] = []
        self._after: list[tuple[float, Array, Array]] = []
        self._base = (0.0, mean, np.diag(START))

    def take(self, told: Told) -> None:
        """Put a reading in its place and compute everything since then again."""
        place = bisect_right([each.time for each in self._readings], told.time)
        self._readings.insert(place, told)
        del self._after[place:]
        time, mean, spread = self._after[-1] if self._after else self._base
        for each in self._readings[place:]:
            mean, spread = _updated(*_predicted(mean, spread, each.time - time), each)
            time = each.time
            self._after.append((time, mean, spread))

    def at(self, now: float) -> tuple[Array, Array]:
        """Mean and covariance at `now`, s; readings older than the horizon are final."""
        old = bisect_right([each.time for each in self._readings], now - HORIZON)
        if old:
            self._base = self._after[old - 1]
            del self._readings[:old], self._after[:old]
        time, mean, spread = self._after[-1] if self._after else self._base
        return _predicted(mean, spread, now - time)


def _predicted(mean: Array, spread: Array, dt: float) -> tuple[Array, Array]:
    if dt <= 0.0:
        return mean, spread
    x, y, theta, v, omega, bias, scale = mean
    half = theta + 0.5 * omega * dt
    c, s = dt * cos(half), dt * sin(half)
    f = np.eye(7)
    f[0, 2], f[0, 3], f[0, 4] = -v * s, c, -0.5 * dt * v * s
    f[1, 2], f[1, 3], f[1, 4] = v * c, s, 0.5 * dt * v * c
    f[2, 4] = dt
    moved = np.array([x + v * c, y + v * s, theta + omega * dt, v, omega, bias, scale])
    return moved, f @ spread @ f.T + np.diag(Q * dt)


def _updated(mean: Array, spread: Array, told: Told) -> tuple[Array, Array]:
    x, y, theta, v, omega, bias, scale = mean
    h: Any = np.zeros((len(told.values), 7))
    if told.sensor == "wheels":
        expected = np.array([scale * v, scale * omega])
        h[0, 3], h[0, 6], h[1, 4], h[1, 6] = scale, v, scale, omega
    elif told.sensor == "imu":
        expected = np.array([omega + bias])
        h[0, 4] = h[0, 5] = 1.0
    else:
        c, s = told.at * cos(theta), told.at * sin(theta)
        expected = np.array([x + c, y + s, theta])[: len(told.values)]
        h[:, :3] = np.eye(3)[: len(told.values)]
        h[0, 2], h[1, 2] = -s, c
    residual = told.values - expected
    if len(residual) == 3:
        residual[2] = wrap_angle(residual[2])
    covariance = h @ spread @ h.T + np.diag(SIGMAS[told.sensor] ** 2)
    inverse = np.linalg.inv(covariance)
    if told.sensor == "gps" and residual @ inverse @ residual > GATE:
        return mean, spread
    gain = spread @ h.T @ inverse
    after = spread - gain @ h @ spread
    return mean + gain @ residual, 0.5 * (after + after.T)
