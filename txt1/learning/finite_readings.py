"""The gate for numbers before every learner: no NaN, no infinity and no negative reading passes it.

A sensor may fail to tell a number now and then: a plug is loose, a message is lost. Such a sample repeats the sensor's
last number. After `DARK_AFTER` s without a number the sensor counts as dark, 0 lux, as a dead one does. A learner that
needs all four sensors then refuses it. If no sensor tells a number, there is nothing to learn from, and the gate itself
refuses it. Odometry that is no number repeats the last odometry.
"""

from math import inf, isfinite
from typing import Final

from txt1.errors import LightFault
from txt1.model.light_sensors import SENSORS, Readings
from txt1.model.odometry import Odometry

# s
DARK_AFTER: Final = 0.5


class FiniteReadings:
    """The gate of one robot; see the module."""

    def __init__(self) -> None:
        self._odometry = Odometry()
        self.clear()

    def clear(self) -> None:
        """Forget the sensors' last numbers: an episode begins."""
        self._last: list[float | None] = [None] * len(SENSORS)
        self._since = [-inf] * len(SENSORS)
        # the fault of a sensor that counts as dark; "" if there is none
        self.fault = ""

    def readings(self, now: float, sample: Readings) -> Readings | None:
        """Return the numbers of a sample, lux, at `now` s; None: a sensor has not told a number yet.

        Raises LightFault: no sensor tells a number any more.
        """
        fl, fr, rl, rr = sample
        if 0.0 <= fl < inf and 0.0 <= fr < inf and 0.0 <= rl < inf and 0.0 <= rr < inf:
            self._last[:] = sample
            self._since[:] = (now, now, now, now)
            self.fault = ""
            return sample
        silent = []
        for k, lux in enumerate(sample):
            if 0.0 <= lux < inf:
                self._last[k], self._since[k] = lux, now
            elif self._since[k] == -inf:
                # the first sample of all
                self._since[k] = now
            elif now - self._since[k] > DARK_AFTER:
                self._last[k] = 0.0
                silent.append(k)
        self.fault = "; ".join(f"light sensor {SENSORS[k]} reads {sample[k]:g}, which is no reading" for k in silent)
        if len(silent) == len(SENSORS):
            raise LightFault(self.fault)
        numbers = [lux for lux in self._last if lux is not None]
        return Readings(*numbers) if len(numbers) == len(SENSORS) else None

    def odometry(self, odometry: Odometry) -> Odometry:
        """Return the odometry, or the last one that was all numbers."""
        if isfinite(odometry.x + odometry.y + odometry.theta + odometry.v + odometry.omega):
            self._odometry = odometry
        return self._odometry
