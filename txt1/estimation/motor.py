"""A witness of the speed that nobody has to calibrate: the motor needs the same output for the same set-point.

If the output changes suddenly, either the floor has changed or the encoders err. Both look alike, so the
encoders stay believed, and the estimate says less of itself by the way that this would make.
"""

from typing import Final

# s after a new set-point from which on the motor's output is the usual one for it
SETTLED: Final = 2.0
# s, the time constant of the output: encoders of coarse counts make it jump
SMOOTH: Final = 0.5
# s, that of the usual one: batteries and motors change slowly
USUAL: Final = 30.0
# share by which the output may differ: curves, and a floor that is not even
BAND: Final = 0.15
# m/s by which the set-point may change and be the same
SAME: Final = 0.02


class MotorWitness:
    """Compares the motor's counts with the set-point's usual counts."""

    def __init__(self) -> None:
        self._setpoint = 0.0
        # s for which that has been in force
        self._since = 0.0
        self._smooth = 0.0  # counts
        self._usual = 0.0  # counts

    def doubt(self, setpoint: float, motor: float, dt: float) -> float:
        """Return the motor's apparent speed above the encoders', m/s; 0 within the usual scatter.

        Args:
            setpoint: m/s.
            motor: the output meanwhile, counts, of the set-point's sign.
            dt: s since the last call.

        """
        if abs(setpoint - self._setpoint) > SAME or setpoint == 0.0:
            self._setpoint, self._since, self._smooth = setpoint, 0.0, motor
            return 0.0
        self._since += dt
        self._smooth += (motor - self._smooth) * (dt / SMOOTH if dt < SMOOTH else 1.0)
        if self._since < SETTLED or self._usual * setpoint <= 0.0:
            self._usual = self._smooth
            return 0.0
        self._usual += (self._smooth - self._usual) * (dt / USUAL if dt < USUAL else 1.0)
        share = self._smooth / self._usual - 1.0
        return setpoint * share if abs(share) > BAND else 0.0
