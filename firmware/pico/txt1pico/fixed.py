"""The velocity-form PID controller (thesis 4.7) in whole numbers, exact, and without a byte of memory per step.

MicroPython makes an object of every float and of every integer beyond 30 bits, so both are avoided here. An error is
given in parts of 1 mm/s or 1 mrad/s (`scale` of them), gains in thousandths, as the wire carries them. The output is

    u(k) = u(k-1) + K_P [e(k) - e(k-1)] + K_I dt e(k) + K_D/dt [e(k) - 2 e(k-1) + e(k-2)],   dt = 20 ms,

a whole number of PWM counts and a remainder in parts of 1 / (50000 scale): nothing is rounded, so nothing drifts.
Products are taken in two halves, which is why gains and errors have limits.
"""

KP_MAX = 1 << 18
KI_MAX = 1 << 20
KD_MAX = 1 << 17
"""Largest gains in thousandths that the halves have room for: 262 counts per mm/s, 1048 /s, 131 s."""


class Pid:
    """One loop.

    Args:
        scale: parts of 1 mm/s or 1 mrad/s in which errors are given: a multiple of 16, at most 128.
        limit: largest absolute output, PWM counts.

    """

    def __init__(self, scale, limit):
        self.limit = limit
        self.half = 8 * scale
        self.whole = 50000 * scale
        self.clear()

    def clear(self):
        """Forget the past: output and errors 0."""
        self.output = self.counts = self.rest = 0
        self.error = self.before = 0

    def step(self, error, kp, ki, kd):
        """Take a new error; the output in PWM counts, cut towards 0, is left in `output`."""
        half, whole = self.half, self.whole
        change = error - self.error
        bend = change - self.error + self.before
        # proportional, in 1000 scale = 125 half
        high, low = kp * (change // half), kp * (change % half)
        counts = high // 125
        rest = (high % 125) * half + low
        counts += rest // (125 * half)
        rest = rest % (125 * half) * 50
        # integral, in 50000 scale = 6250 half
        high, low = ki * (error // half), ki * (error % half)
        counts += high // 6250
        part = (high % 6250) * half + low
        counts += part // whole
        rest += part % whole
        # derivative, in 20 scale = 5/2 half
        high, low = 2 * kd * (bend // half), kd * (bend % half)
        counts += high // 5
        part = (high % 5) * (half // 2) + low
        counts += part // (5 * (half // 2))
        rest += part % (5 * (half // 2)) * 2500
        rest += self.rest
        counts += self.counts + rest // whole
        rest %= whole
        limit = self.limit
        if counts >= limit:
            counts, rest = limit, 0
        elif counts < -limit:
            counts, rest = -limit, 0
        self.counts, self.rest = counts, rest
        self.before, self.error = self.error, error
        self.output = counts + 1 if counts < 0 and rest else counts
