"""The velocity loops: set-point and measured velocities in, motor and steering PWM out (thesis 4).

The controller task and the learning environment call these functions; so does, compiled by numba, the simulation of
many robots.
"""

from __future__ import annotations

from txt1.control.pid import CLEAR, Gains, pid
from txt1.model.vehicle import PWM_MAX, STEERING_MAX


def at_rest(v: float, v_now: float) -> bool:
    """Whether set-point and measured speed are 0: there is nothing to control, so nothing hums."""
    return v == 0.0 and v_now == 0.0


def errors(v: float, omega: float, v_now: float, omega_now: float) -> tuple[float, float]:
    """Errors of speed (mm/s) and yaw rate (mrad/s), for a set-point and measured velocities in m/s and rad/s.

    In reverse the steering acts the other way round, so there the yaw-rate error changes its sign.
    """
    yaw_error = 1000.0 * (omega - omega_now)
    return 1000.0 * (v - v_now), -yaw_error if v_now < 0.0 else yaw_error


class VelocityLoops:
    """The two PID loops. Errors in mm/s and mrad/s, outputs in PWM counts."""

    def __init__(self) -> None:
        self._linear = self._angular = CLEAR

    def clear(self) -> None:
        """Forget the past."""
        self._linear = self._angular = CLEAR

    def step(
        self, v: float, omega: float, v_now: float, omega_now: float, linear: Gains, angular: Gains, dt: float
    ) -> tuple[float, float]:
        """Motor and steering output, counts, for a set-point and measured velocities in m/s and rad/s, every dt s.

        A steering output above 0 turns left: the front wheels to the left, the rear ones to the right. Without a new
        measurement (dt = 0) the outputs are held.
        """
        if dt > 0.0:
            error, yaw_error = errors(v, omega, v_now, omega_now)
            self._linear = pid(self._linear, error, linear, dt, PWM_MAX)
            self._angular = pid(self._angular, yaw_error, angular, dt, STEERING_MAX)
        return self._linear[0], self._angular[0]
