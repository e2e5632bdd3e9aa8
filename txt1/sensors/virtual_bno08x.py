"""A virtual BNO08x in UART-RVC: it sends a frame for each reading."""

from itertools import count
from math import asin, atan2, degrees

from txt1.sensors.base import Reading
from txt1.sensors.imu_bno08x import pack
from txt1.sensors.readings import STANDARD_GRAVITY, ImuReading, Quaternion, Vector
from txt1.sensors.virtual_sensor import Talker


def angles_of(orientation: Quaternion) -> Vector:
    """Return yaw, pitch about x and roll about y of an orientation, degrees."""
    x, y, z, w = orientation
    pitch = asin(max(-1.0, min(1.0, 2.0 * (y * z + w * x))))
    roll = atan2(2.0 * (w * y - x * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
    return degrees(yaw), degrees(pitch), degrees(roll)


def bno08x() -> Talker:
    """Return a device whose x axis points forward."""
    index = count()

    def frame(reading: Reading[ImuReading]) -> bytes:
        value = reading.value
        ax, ay, az = value.acceleration
        angles = angles_of(value.orientation or (0.0, 0.0, 0.0, 1.0))
        return pack(next(index), angles, (ax / STANDARD_GRAVITY, ay / STANDARD_GRAVITY, az / STANDARD_GRAVITY))

    return Talker(frame)
