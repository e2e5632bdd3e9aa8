"""The hand rule: how two axes become a velocity, for keys, gamepads, the page and the live view.

The axis `ahead`, -1 to 1, is a share of the speed that the hand has chosen: v = speed * ahead. The axis `left` is a
share of the largest yaw rate at that moment. A car that steers has abs(v) / R, (2.16): at rest nothing turns. A rover
whose sides run at two speeds has speed / R at rest, too, with R at least half its track: no side rolls faster than the
chosen speed when it turns in place.

Left is counter-clockwise; on a `wheel` it is the side to which a car's front wheels point, so in reverse a car that
steers turns the other way. The page computes the same (`txt1/web/static/hand.js`) by the numbers of `Hand`, which
`/hand` tells it.
"""

from math import copysign, isfinite
from typing import Final, NamedTuple

from txt1.control.limits import clip
from txt1.control.parameters import Safety
from txt1.model.vehicle import Geometry

DEAD: Final = 0.1  # share of an axis around its middle that counts as none


def shaped(value: float) -> float:
    """Return an axis without its dead middle, -1 to 1; one that is no number is at rest."""
    size = max(0.0, (abs(value) - DEAD) / (1.0 - DEAD)) if isfinite(value) else 0.0
    return copysign(min(1.0, size), value)


class Hand(NamedTuple):
    """The numbers of the hand rule, which are a car's own; those of the TXT-1 by default.

    Its fastest speed, m/s, and turn, rad/s; the radius R, m; whether it turns in place; the share of the largest yaw
    rate that a key asks for.
    """

    v_max: float = Safety().v_max
    omega_max: float = Safety().omega_max
    radius: float = Geometry().radius_min
    pivots: bool = False
    turn: float = 0.8

    def velocity(self, speed: float, ahead: float, left: float, *, wheel: bool = False) -> tuple[float, float]:
        """Return v (m/s) and omega (rad/s) of two axes, at the speed in m/s that the hand has chosen."""
        speed = min(speed, self.v_max)
        v = speed * ahead
        if wheel and v < 0.0 and not self.pivots:
            left = -left
        omega = left * (speed if self.pivots else abs(v)) / self.radius
        return v + 0.0, clip(omega, self.omega_max) + 0.0  # never -0.0, which looks odd

    def on_the_spot(self, v: float, omega: float) -> tuple[float, float]:
        """Return a velocity with its turn in place, m/s and rad/s: a car that steers drives its smallest circle."""
        return (v if v or self.pivots else self.radius * abs(omega)), omega


DEFAULT_HAND: Final = Hand()
