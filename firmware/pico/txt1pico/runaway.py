"""Notices from the encoders that the robot does not do what the outputs say. Times in ms, speeds in 1/128 mm/s."""

from txt1pico import facts

NOTHING, FAST, APART, AGAINST, BOTH_SILENT, RIGHT_SILENT, LEFT_SILENT = range(7)


class RunawayWatch:
    """Watches the encoders, and combined odometry while it is in use."""

    def __init__(self):
        self.clear()

    def clear(self):
        """Forget all suspicions."""
        self._fast = self._apart = self._against = 0
        self._right = self._left = self._right_passed = self._left_passed = 0

    def check(self, motor, right, left, v, v_combined, dt):
        """Return what is wrong, or NOTHING.

        Args:
            motor: output, PWM counts.
            right: counts of the right encoder in the last `dt` ms.
            left: counts of the left one.
            v: speed by the encoders, 1/128 mm/s.
            v_combined: speed by combined odometry while the loops use it, or `v`.
            dt: ms.

        """
        fast = abs(v) > facts.RUNAWAY_SPEED * 128
        apart = abs(v_combined - v) > facts.DISAGREEMENT * 128
        if right * left > 0 and not (fast or apart):
            self.clear()
            return NOTHING
        self._fast = self._fast + dt if fast else 0
        if self._fast >= facts.PERSISTS:
            return FAST
        self._apart = self._apart + dt if apart else 0
        if self._apart >= facts.RUNAWAY_TIME:
            return APART
        against = right * left < 0 and min(abs(right), abs(left)) > facts.NOISE_COUNTS
        self._against = self._against + dt if against else 0
        if self._against >= facts.PERSISTS:
            return AGAINST
        driven = abs(motor) > facts.RUNAWAY_MOTOR
        if right:
            self._right = self._right_passed = 0
        else:
            self._right = self._right + dt if driven else 0
            self._right_passed += abs(left)
        if left:
            self._left = self._left_passed = 0
        else:
            self._left = self._left + dt if driven else 0
            self._left_passed += abs(right)
        right_long = self._right >= facts.RUNAWAY_TIME or self._right_passed > facts.RUNAWAY_COUNTS
        left_long = self._left >= facts.RUNAWAY_TIME or self._left_passed > facts.RUNAWAY_COUNTS
        if right_long and left_long:
            return BOTH_SILENT
        if right_long:
            return RIGHT_SILENT
        return LEFT_SILENT if left_long else NOTHING
