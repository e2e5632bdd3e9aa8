"""Noticing that the robot does not do what the outputs say, from the encoders alone."""

from __future__ import annotations

from typing import Final

from txt1.control.parameters import Safety

PERSISTS: Final = 0.1  # time for which readings that the geometry forbids must last to be believed, s
NOISE_COUNTS: Final = 3  # counts per period that a wheel at rest may show
DISAGREEMENT: Final = 0.5  # difference between combined odometry and the encoders that slip does not explain, m/s


class RunawayWatch:
    """Watches encoder ticks, and combined odometry while it is in use.

    At full lock the inner wheel of the two turns at 0.63 of the outer one's speed, so it is never silent for long.
    """

    def __init__(self, limits: Safety) -> None:
        self._limits = limits
        self.clear()

    def clear(self) -> None:
        """Forget all suspicions."""
        self._calm = True
        self._silent = [0.0, 0.0]  # how long each wheel has been silent under power, s
        self._passed = [0, 0]  # counts of the other wheel meanwhile
        self._against = 0.0  # how long the wheels have turned against each other, s
        self._fast = 0.0  # how long the vehicle has been too fast, s
        self._apart = 0.0  # how long combined odometry and encoders have disagreed, s

    def check(self, motor: int, right: int, left: int, v: float, v_combined: float | None, dt: float) -> str | None:
        """Why this is a runaway, or None.

        Given are the motor's output (PWM counts), both encoders' ticks in the last `dt` s, and the speeds (m/s) by
        the encoders and by combined odometry, while the loops use that.
        """
        fast = abs(v) > self._limits.runaway_speed
        apart = v_combined is not None and abs(v_combined - v) > DISAGREEMENT
        if not (fast or apart):
            if right * left > 0:  # both turn the same way
                if not self._calm:
                    self.clear()
                return None
            if self._calm and right == left == 0 and abs(motor) <= self._limits.runaway_motor:  # at rest
                return None
        self._calm = False
        self._fast = self._fast + dt if fast else 0.0
        if self._fast >= PERSISTS:
            return f"{abs(v):.1f} m/s is faster than was ever asked for"
        self._apart = self._apart + dt if apart else 0.0
        if self._apart >= self._limits.runaway_time:
            return f"combined odometry says {v_combined:.1f} m/s, the encoders {v:.1f} m/s"
        against = right * left < 0 and min(abs(right), abs(left)) > NOISE_COUNTS
        self._against = self._against + dt if against else 0.0
        if self._against >= PERSISTS:
            return "the encoders turn against each other"
        return self._check_silence(abs(motor) > self._limits.runaway_motor, right, left, dt)

    def _check_silence(self, driven: bool, right: int, left: int, dt: float) -> str | None:
        for wheel, ticks, other in ((0, right, left), (1, left, right)):
            if ticks:
                self._silent[wheel], self._passed[wheel] = 0.0, 0
                continue
            self._silent[wheel] = self._silent[wheel] + dt if driven else 0.0
            self._passed[wheel] += abs(other)
        too_long = [
            s >= self._limits.runaway_time or p > self._limits.runaway_counts
            for s, p in zip(self._silent, self._passed, strict=True)
        ]
        if all(too_long):
            return "both encoders are silent, or something blocks the robot"
        if any(too_long):
            return f"the {'right' if too_long[0] else 'left'} encoder is silent"
        return None
