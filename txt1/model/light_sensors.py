"""The four light sensors: where they sit, how often they are read, what they can tell (thesis 3.7, 5.3)."""

from enum import StrEnum
from typing import Final, NamedTuple

# sensors sit so far in front of and behind the robot's centre, m
SENSOR_X: Final = 0.2286
# and so far to its left and right, m
SENSOR_Y: Final = 0.127
# in the order of `Readings`: front and rear, left and right
SENSORS: Final = ("FL", "FR", "RL", "RR")
SAMPLE_PERIOD: Final = 0.016  # s
# the least a sensor tells from darkness, lux
LUX_MIN: Final = 1.0
# at this a sensor saturates, lux
LUX_MAX: Final = 1000.0


# of a sensor on the robot: (forward, left), m
Place = tuple[float, float]
# of the four sensors, in the order of `Readings`
Mount = tuple[Place, Place, Place, Place]
# factors on their readings
Gains = tuple[float, float, float, float]
# the same as (forward, left) of each, m
MOUNT: Final[Mount] = (
    (SENSOR_X, SENSOR_Y),
    (SENSOR_X, -SENSOR_Y),
    (-SENSOR_X, SENSOR_Y),
    (-SENSOR_X, -SENSOR_Y),
)
# four sensors alike
EVEN: Final[Gains] = (1.0, 1.0, 1.0, 1.0)


class Readings(NamedTuple):
    """One sample of the four sensors, lux."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


class SensorFault(StrEnum):
    """What is wrong with a sensor."""

    NONE = "none"
    # its wire is off: it reads 0
    DEAD = "dead"
    # its driver gives no number
    NAN = "nan"
    # it repeats the reading it had
    FROZEN = "frozen"


# four sensors in order
SOUND: Final = (SensorFault.NONE, SensorFault.NONE, SensorFault.NONE, SensorFault.NONE)
