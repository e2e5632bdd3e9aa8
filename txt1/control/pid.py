"""The velocity-form PID controller (thesis 4.1) and the velocity loops made of it (thesis 4).

The controller task and the learning environment call these functions. The simulation of many robots calls them too,
compiled by numba.
"""

from typing import NamedTuple

from txt1.model.vehicle import PWM_LIMIT, STEERING_LIMIT


class Gains(NamedTuple):
    """Proportional, integral (1/s) and derivative (s) gain; PWM counts per mm/s or mrad/s of error."""

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0


Past = tuple[float, float, float]
"""A controller's state: its output u(k-1), PWM counts, and the errors e(k-1) and e(k-2)."""

# the state at power-up
CLEAR: Past = (0.0, 0.0, 0.0)


def pid(past: Past, error: float, gains: tuple[float, float, float], dt: float, limit: float) -> Past:
    """The next state, whose output is u(k) in PWM counts, for an error e(k) in mm/s or mrad/s and a period dt in s.

    u(k) = u(k-1) + K_P [e(k) - e(k-1)] + K_I dt e(k) + K_D/dt [e(k) - 2 e(k-1) + e(k-2)], (4.7)

    The output is limited to +-limit, and so is the u(k-1) that the next step starts from: the velocity form does not
    wind up.
    """
    output, e1, e2 = past
    kp, ki, kd = gains
    u = output + kp * (error - e1) + ki * dt * error + kd / dt * (error - 2.0 * e1 + e2)
    if u > limit:
        u = limit
    elif u < -limit:
        u = -limit
    return u, error, e1


def at_rest(v: float, v_now: float) -> bool:
    """Whether set-point and measured speed are 0: then there is nothing to control, and the motor does not hum."""
    return v == 0.0 and v_now == 0.0


def errors(v: float, omega: float, v_now: float, omega_now: float) -> tuple[float, float]:
    """Errors of speed (mm/s) and yaw rate (mrad/s), for a set-point and measured velocities in m/s and rad/s.

    In reverse the steering acts in the opposite direction, so the yaw-rate error changes its sign.
    """
    yaw_error = 1000.0 * (omega - omega_now)
    return 1000.0 * (v - v_now), -yaw_error if v_now < 0.0 else yaw_error


class VelocityLoops:
    """The two PID loops. Errors in mm/s and mrad/s, outputs in PWM counts.

    `steers`: wheels that steer make the yaw rate, so its error changes its sign in reverse. Sides at two speeds do not.
    """

    def __init__(self, steers: bool) -> None:
        self._steers = steers
        self._linear = self._angular = CLEAR

    def clear(self) -> None:
        """Forget the past."""
        self._linear = self._angular = CLEAR

    def step(
        self, v: float, omega: float, v_now: float, omega_now: float, linear: Gains, angular: Gains, dt: float
    ) -> tuple[float, float]:
        """Return motor and steering output, counts, for a set-point and measured velocities in m/s and rad/s, every dt
        s.

        A steering output above 0 turns left: the front wheels to the left, the rear wheels to the right. Without a new
        measurement (dt = 0) the outputs are held.
        """
        if dt > 0.0:
            error, yaw_error = errors(v, omega, v_now, omega_now)
            if v_now < 0.0 and not self._steers:
                yaw_error = -yaw_error
            self._linear = pid(self._linear, error, linear, dt, PWM_LIMIT)
            self._angular = pid(self._angular, yaw_error, angular, dt, STEERING_LIMIT)
        return self._linear[0], self._angular[0]
