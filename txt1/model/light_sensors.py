"""The four light sensors: where they sit, how often they are read, what they can tell (thesis 3.7, 5.3)."""

from enum import StrEnum
from typing import Final, NamedTuple

SENSOR_X: Final = 0.2286  # sensors sit so far in front of and behind the robot's centre, m
SENSOR_Y: Final = 0.127  # and so far to its left and right, m
SENSORS: Final = ("FL", "FR", "RL", "RR")  # in the order of `Readings`: front and rear, left and right
SAMPLE_PERIOD: Final = 0.016  # s
LUX_MIN: Final = 1.0  # the least a sensor tells from darkness, lux
LUX_MAX: Final = 1000.0  # at this a sensor saturates, lux


Place = tuple[float, float]  # of a sensor on the robot: (forward, left), m
Mount = tuple[Place, Place, Place, Place]  # of the four sensors, in the order of `Readings`
Gains = tuple[float, float, float, float]  # factors on their readings
MOUNT: Final[Mount] = (
    (SENSOR_X, SENSOR_Y),
    (SENSOR_X, -SENSOR_Y),
    (-SENSOR_X, SENSOR_Y),
    (-SENSOR_X, -SENSOR_Y),
)  # the same as (forward, left) of each, m
EVEN: Final[Gains] = (1.0, 1.0, 1.0, 1.0)  # four sensors alike


class Readings(NamedTuple):
    """One sample of the four sensors, lux."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


class SensorFault(StrEnum):
    """What is wrong with a sensor."""

    NONE = "none"
    DEAD = "dead"  # its wire is off: it reads 0
    NAN = "nan"  # its driver gives no number
    FROZEN = "frozen"  # it repeats the reading it had


SOUND: Final = (SensorFault.NONE, SensorFault.NONE, SensorFault.NONE, SensorFault.NONE)  # four sensors in order
