"""The velocity-form PID controller (thesis 4.1)."""

from __future__ import annotations

from typing import NamedTuple


class Gains(NamedTuple):
    """Proportional, integral (1/s) and derivative (s) gain; PWM counts per mm/s or mrad/s of error."""

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0


class Pid:
    """u(k) = u(k-1) + K_P [e(k) - e(k-1)] + K_I dt e(k) + K_D/dt [e(k) - 2 e(k-1) + e(k-2)], (4.7).

    The output is limited, and so is the u(k-1) that the next step starts from: the velocity form does not wind up.

    Args:
        limit: largest absolute output, PWM counts.

    """

    __slots__ = ("error", "limit", "output", "previous_error")

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.clear()

    def clear(self) -> None:
        """Forget the past: output and errors 0, as at power-up."""
        self.output = 0.0
        self.error = 0.0
        self.previous_error = 0.0

    def step(self, error: float, gains: Gains, dt: float) -> float:
        """The next output in PWM counts, for an error in mm/s or mrad/s and a period in seconds."""
        kp, ki, kd = gains
        e1, e2 = self.error, self.previous_error
        u = self.output + kp * (error - e1) + ki * dt * error + kd / dt * (error - 2.0 * e1 + e2)
        if u > self.limit:
            u = self.limit
        elif u < -self.limit:
            u = -self.limit
        self.output, self.error, self.previous_error = u, error, e1
        return u
