"""Odometry from the two encoder wheels (thesis 2.3, 3.7.1) in whole numbers.

The heading is kept in parts of a turn (2^28 of them, and 2^-20 of one more), the position in half counts and a
remainder. Between two cycles the robot turns by less than 0.1 rad, so the chord at the mean heading is the arc to 5
parts in 10 000.
"""

from array import array
from math import pi

from txt1pico import facts

TURN = 1 << 28
SINES = array(
    "h",
    (
        0,
        804,
        1608,
        2410,
        3212,
        4011,
        4808,
        5602,
        6393,
        7179,
        7962,
        8739,
        9512,
        10278,
        11039,
        11793,
        12539,
        13279,
        14010,
        14732,
        15446,
        16151,
        16846,
        17530,
        18204,
        18868,
        19519,
        20159,
        20787,
        21403,
        22005,
        22594,
        23170,
        23731,
        24279,
        24811,
        25329,
        25832,
        26319,
        26790,
        27245,
        27683,
        28105,
        28510,
        28898,
        29268,
        29621,
        29956,
        30273,
        30571,
        30852,
        31113,
        31356,
        31580,
        31785,
        31971,
        32137,
        32285,
        32412,
        32521,
        32609,
        32678,
        32728,
        32757,
        32767,
    ),
)
"""A quarter of the sine, 32767 high, in 64 steps."""


def sine(angle):
    """The sine of an angle in parts of a turn (2^28), 32767 high, to 3 in 32767."""
    angle &= TURN - 1
    negative = angle >= TURN // 2
    if negative:
        angle -= TURN // 2
    if angle > TURN // 4:
        angle = TURN // 2 - angle
    at, between = angle >> 20, angle & 0xFFFFF
    value = SINES[at]
    if between:
        value += ((SINES[at + 1] - value) * (between >> 8)) >> 12
    return -value if negative else value


class Odometry:
    """The pose where odometry started, and the velocities.

    Args:
        circumference: of a tyre, 0.1 mm, a multiple of 5.
        track: between the encoder wheels, mm.

    Attributes:
        x, y: mm.
        theta: mrad, -3142 to 3142.
        v: speed in 1/128 mm/s.
        omega: yaw rate in 1/16 mrad/s.

    """

    def __init__(self, circumference=facts.CIRCUMFERENCE, track=facts.TRACK_WIDTH):
        self._path = circumference // 5
        self._circumference = circumference
        self._turn = circumference * 50
        self._track = track
        turn = TURN * circumference / 10.0 / facts.COUNTS_PER_REV / (2.0 * pi * track)
        self._turn_high = int(turn)
        self._turn_low = int((turn - int(turn)) * (1 << 20))
        self.clear()

    def clear(self):
        """Begin at the origin, at rest."""
        self.x = self.y = self.theta = self.v = self.omega = 0
        self._heading = self._more = 0
        self._x = self._y = self._x_rest = self._y_rest = 0

    def advance(self, right, left, periods):
        """Take the counts of both wheels in the last `periods` of 20 ms (at least 1)."""
        path, turned = right + left, right - left
        self.v = path * self._path // periods
        self.omega = turned * self._turn // (self._track * periods)
        if not (path or turned):
            return
        more = self._more + turned * self._turn_low
        step = turned * self._turn_high + (more >> 20)
        self._more = more & 0xFFFFF
        mean = self._heading + (step >> 1)
        self._heading = (self._heading + step) & (TURN - 1)
        rest = self._x_rest + path * sine(mean + TURN // 4)
        self._x += rest // 32767
        self._x_rest = rest % 32767
        rest = self._y_rest + path * sine(mean)
        self._y += rest // 32767
        self._y_rest = rest % 32767
        self.x = self._millimetres(self._x)
        self.y = self._millimetres(self._y)
        # 2^28 parts are 2 pi: 6283.185 mrad
        heading = self._heading if self._heading <= TURN // 2 else self._heading - TURN
        self.theta = ((heading >> 12) * 6283 + (heading >> 12) * 12 // 65 + (1 << 15)) >> 16

    def _millimetres(self, halves):
        """Half counts, 32000 of which are ten circumferences' worth of 0.1 mm, as mm."""
        whole, rest = halves // 32000, halves % 32000
        return whole * self._circumference + (rest * self._circumference + 16000) // 32000
