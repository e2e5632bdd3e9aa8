"""The hand rule: how two axes become a velocity, for keys, gamepads, the page and the live view.

The axis `ahead`, -1 to 1, is a share of the chosen speed: v = speed * ahead. The axis `left` is a share of the largest
yaw rate at that moment. For a car that steers this is abs(v) / R, (2.16), so at rest it does not turn. A rover whose
sides run at two speeds has speed / R even at rest, with R at least half its track: no side rolls faster than the chosen
speed when it turns in place.

Left is counter-clockwise. On a `wheel` it is the side to which a car's front wheels point, so in reverse a car that
steers turns the other way. The page computes the same (`txt1/web/static/hand.js`) with the numbers of `Hand`, which
`/hand` gives it.
"""

from math import copysign, isfinite
from typing import Final, NamedTuple

from txt1.control.limits import clip
from txt1.control.parameters import Safety
from txt1.model.vehicle import Geometry

# share of an axis around its middle that counts as zero
DEAD: Final = 0.1


def shaped(value: float) -> float:
    """Return an axis without its dead middle, -1 to 1; 0 for a value that is not finite."""
    size = max(0.0, (abs(value) - DEAD) / (1.0 - DEAD)) if isfinite(value) else 0.0
    return copysign(min(1.0, size), value)


class Hand(NamedTuple):
    """The numbers of the hand rule for a car; by default those of the TXT-1.

    They are its top speed, m/s, and turn, rad/s; the radius R, m; whether it turns in place; and the share of the
    largest yaw rate that a key asks for.
    """

    v_max: float = Safety().v_max
    omega_max: float = Safety().omega_max
    radius: float = Geometry().radius_min
    pivots: bool = False
    turn: float = 0.8

    def velocity(self, speed: float, ahead: float, left: float, *, wheel: bool = False) -> tuple[float, float]:
        """Return v (m/s) and omega (rad/s) for two axes, at the chosen speed in m/s."""
        speed = min(speed, self.v_max)
        v = speed * ahead
        if wheel and v < 0.0 and not self.pivots:
            left = -left
        omega = left * (speed if self.pivots else abs(v)) / self.radius
        # never -0.0, which looks odd
        return v + 0.0, clip(omega, self.omega_max) + 0.0

    def on_the_spot(self, v: float, omega: float) -> tuple[float, float]:
        """Return a velocity for a turn in place, m/s and rad/s; a car that steers drives its smallest circle."""
        return (v if v or self.pivots else self.radius * abs(omega)), omega


DEFAULT_HAND: Final = Hand()
