"""Odometry from the two encoder wheels (thesis 2.3, 3.7.1)."""

from typing import NamedTuple

from txt1.model.kinematics import move_along_arc
from txt1.model.vehicle import Geometry
from txt1.units import new


class Odometry(NamedTuple):
    """Pose in the frame of the odometry's start, and velocities in the vehicle's frame."""

    x: float = 0.0  # m
    y: float = 0.0  # m
    # rad, in (-pi, pi]
    theta: float = 0.0
    # speed along the vehicle's axis, m/s
    v: float = 0.0
    # yaw rate, rad/s
    omega: float = 0.0


def body_velocity(right: int, left: int, dt: float, count_length: float, track_width: float) -> tuple[float, float]:
    """Return speed and yaw rate (v, omega) from the encoders' ticks in dt s; `count_length` is C_W / CPR in m."""
    # (3.1)
    v_right, v_left = right * count_length / dt, left * count_length / dt
    # (2.21), (2.24)
    return (v_right + v_left) / 2.0, (v_right - v_left) / track_width


class WheelOdometry:
    """Odometry from the counters of the two encoder wheels; `odometry` is that of the last reading."""

    def __init__(self, geometry: Geometry) -> None:
        self.odometry = Odometry()
        self._count_length, self._track_width = geometry.count_length, geometry.track_width
        self._counts: tuple[int, int] | None = None
        self._time = 0.0
        # whether no wheel turned at the last reading
        self.still = True

    def step(self, counts: tuple[int, int], now: float) -> tuple[int, int] | None:
        """Bring the odometry up to `now`; return the counts (right, left) since the last reading, None at the first."""
        # the measured interval: a late reading gives the same speed
        before, dt = self._counts, now - self._time
        self._counts, self._time = counts, now
        if before is None:
            return None
        right, left = counts[0] - before[0], counts[1] - before[1]
        if right or left or not self.still:
            v, omega = body_velocity(right, left, dt, self._count_length, self._track_width)
            self.odometry = advance(self.odometry, v, omega, dt)
            self.still = not (right or left)
        return right, left


def wheel_ticks(v: float, omega: float, dt: float, geometry: Geometry) -> tuple[int, int]:
    """Return the encoder counts for a speed and yaw rate in dt s: the inverse of (2.21), (2.24) and (3.1)."""
    turning = 0.5 * geometry.track_width * omega
    return round((v + turning) * dt / geometry.count_length), round((v - turning) * dt / geometry.count_length)


def advance(odometry: Odometry, v: float, omega: float, dt: float) -> Odometry:
    """Return the odometry after moving for dt seconds at constant (v, omega)."""
    x, y, theta, _, _ = odometry
    if v == 0.0 and omega == 0.0:
        return Odometry(x, y, theta, 0.0, 0.0)
    distance = v * dt
    # m; the curvature of a shorter arc could overflow
    if abs(distance) > 1e-15:
        x, y, theta = move_along_arc(x, y, theta, distance, omega / v, 0.0)
    else:
        # the wheels turn against each other, which only slip can cause
        x, y, theta = move_along_arc(x, y, theta + omega * dt, 0.0, 0.0, 0.0)
    return new(Odometry, (x, y, theta, v, omega))


def rolled(odometry: Odometry, distance: float, curvature: float, v: float) -> Odometry:
    """Return the odometry of a car that steers after `distance` m along an arc (curvature in 1/m), now at v m/s."""
    x, y, theta = move_along_arc(odometry.x, odometry.y, odometry.theta, distance, curvature, 0.0)
    return Odometry(x, y, theta, v, v * curvature)
