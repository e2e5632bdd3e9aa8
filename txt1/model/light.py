"""The four light sensors: where they sit, how often they are read, what they can tell (thesis 3.7, 5.3)."""

from typing import Final, NamedTuple

SENSOR_X: Final = 0.2286  # sensors sit so far in front of and behind the robot's centre, m
SENSOR_Y: Final = 0.127  # and so far to its left and right, m
SENSORS: Final = ("FL", "FR", "RL", "RR")  # in the order of `Readings`: front and rear, left and right
SAMPLE_PERIOD: Final = 0.016  # s
LUX_MIN: Final = 1.0  # the least a sensor tells from darkness, lux
LUX_MAX: Final = 1000.0  # at this a sensor saturates, lux


class Readings(NamedTuple):
    """One sample of the four sensors, lux."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float
