"""The four light sensors: their places, their sampling rate, their range (thesis 3.7, 5.3)."""

from enum import StrEnum
from typing import Final, NamedTuple

# distance of the sensors in front of and behind the robot's centre, m
SENSOR_X: Final = 0.2286
# distance to its left and right, m
SENSOR_Y: Final = 0.127
# in the order of `Readings`: front or rear, left or right
SENSORS: Final = ("FL", "FR", "RL", "RR")
SAMPLE_PERIOD: Final = 0.016  # s
# smallest reading, lux
LUX_MIN: Final = 1.0
# largest reading, lux
LUX_MAX: Final = 1000.0


# place of a sensor on the robot: (forward, left), m
Place = tuple[float, float]
# places of the four sensors, in the order of `Readings`
Mount = tuple[Place, Place, Place, Place]
# factors on the four readings
Gains = tuple[float, float, float, float]
# the default places: (forward, left) of each, m
MOUNT: Final[Mount] = (
    (SENSOR_X, SENSOR_Y),
    (SENSOR_X, -SENSOR_Y),
    (-SENSOR_X, SENSOR_Y),
    (-SENSOR_X, -SENSOR_Y),
)
# four equal sensors
EVEN: Final[Gains] = (1.0, 1.0, 1.0, 1.0)


class Readings(NamedTuple):
    """A sample of the four sensors, lux."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


class SensorFault(StrEnum):
    """A fault of a sensor."""

    NONE = "none"
    # its wire is off: it reads 0
    DEAD = "dead"
    # its driver returns no number
    NAN = "nan"
    # it repeats its last reading
    FROZEN = "frozen"


# the faults of the four sensors in order
SOUND: Final = (SensorFault.NONE, SensorFault.NONE, SensorFault.NONE, SensorFault.NONE)
