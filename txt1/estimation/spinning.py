"""A witness of wheels that spin: no tyre makes a car faster than the floor holds, but a motor does so to a wheel.

The speed that the car can have follows the encoders', and changes by no more than tyres hold. Where the encoders' is
larger, the wheels spin, or an encoder errs. Their counts then are not the car's way.
"""

from math import copysign
from typing import Final

# m/s^2: rubber on a dry floor has 10, racing tyres some more
HOLDS: Final = 15.0
# m/s beyond the possible speed from which on it is told; counts and jitter make less
SPINS: Final = 0.5
# m/s: a counter that jumps makes more, and tells nothing of the wheels
NO_WHEEL: Final = 20.0
# s without any of it, after which it is told again
AGAIN: Final = 5.0


class SpinWitness:
    """Compares the encoders' speed with the highest that the tyres can have given the car."""

    def __init__(self) -> None:
        self._possible = 0.0  # m/s
        # s for which the wheels have not spun
        self._calm = AGAIN

    def doubt(self, v: float, dt: float) -> tuple[float, str]:
        """Return the wheels' speed above the car's possible speed, m/s, and a message if it is new, else "".

        `v` is the encoders' speed over the last `dt` s, m/s.
        """
        self._calm += dt
        if abs(v) > NO_WHEEL:
            return 0.0, ""
        change = v - self._possible
        self._possible += copysign(min(abs(change), HOLDS * dt), change)
        beyond = v - self._possible
        if beyond * v <= 0.0:
            # a speed that falls so fast is a wall's work, or an encoder's without power
            self._possible = v
            return 0.0, ""
        if abs(beyond) <= SPINS:
            return beyond, ""
        calm, self._calm = self._calm, 0.0
        news = f"the wheels spin, or an encoder errs: no tyre makes a car so fast as {abs(v):.1f} m/s so soon"
        return beyond, news if calm >= AGAIN else ""
