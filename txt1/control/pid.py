"""The velocity-form PID controller (thesis 4.1)."""

from __future__ import annotations

from typing import NamedTuple


class Gains(NamedTuple):
    """Proportional, integral (1/s) and derivative (s) gain; PWM counts per mm/s or mrad/s of error."""

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0


Past = tuple[float, float, float]
"""A controller's state: its output u(k-1), PWM counts, and the errors e(k-1) and e(k-2)."""

CLEAR: Past = (0.0, 0.0, 0.0)  # the state at power-up


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
