"""Velocities from tracked poses: the original's Kalman filter on x, y, theta and their rates (75 Hz)."""

from math import copysign, cos, hypot, sin
from typing import Final

from txt1.model.kinematics import wrap_angle

# steps a second for which the noises are given
STEP_RATE: Final = 75.0
# process variance of x, y and theta, per step
PLACE_NOISE: Final = 0.1
# process variance of their rates, per step
RATE_NOISE: Final = 5.0
# variance of a measurement
MEASURED_NOISE: Final = 0.01
# s without a pose after which the filter starts again
POSE_GAP_MAX: Final = 0.5


class _Axis:
    """A constant-velocity Kalman filter of a coordinate: prediction F = [[1, dt], [0, 1]], then the update."""

    def __init__(self, value: float) -> None:
        self.value, self.rate = value, 0.0
        # variance of the value, covariance, variance of the rate
        self._p = (1.0, 0.0, 1.0)

    def step(self, innovation: float, dt: float) -> None:
        """Take a measurement: its difference from the prediction, and the time since the last measurement, s."""
        a, b, c = self._p
        share = dt * STEP_RATE
        a, b, c = a + dt * (2.0 * b + dt * c) + PLACE_NOISE * share, b + dt * c, c + RATE_NOISE * share
        gain, gain_rate = a / (a + MEASURED_NOISE), b / (a + MEASURED_NOISE)
        self.value += self.rate * dt + gain * innovation
        self.rate += gain_rate * innovation
        self._p = (1.0 - gain) * a, (1.0 - gain) * b, c - gain_rate * b


class Differentiator:
    """Computes speed and yaw rate from poses."""

    def __init__(self) -> None:
        self._time: float | None = None
        self._axes = (_Axis(0.0), _Axis(0.0), _Axis(0.0))

    def step(self, time: float, x: float, y: float, theta: float) -> tuple[float | None, float | None]:
        """Take the pose at `time` (s); return speed (m/s, negative backwards) and yaw rate (rad/s), None at the
        first pose.
        """
        if self._time is None or not 0.0 < time - self._time <= POSE_GAP_MAX:
            self._time, self._axes = time, (_Axis(x), _Axis(y), _Axis(theta))
            return None, None
        dt, self._time = time - self._time, time
        along_x, along_y, turning = self._axes
        along_x.step(x - along_x.value - along_x.rate * dt, dt)
        along_y.step(y - along_y.value - along_y.rate * dt, dt)
        turning.step(wrap_angle(theta - turning.value - turning.rate * dt), dt)
        turning.value = wrap_angle(turning.value)
        vx, vy = along_x.rate, along_y.rate
        return copysign(hypot(vx, vy), vx * cos(turning.value) + vy * sin(turning.value)), turning.rate
