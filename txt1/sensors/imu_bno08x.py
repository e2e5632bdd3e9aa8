"""CEVA (Hillcrest) BNO080, BNO085 and BNO086 in UART-RVC, the mode for robot vacuum cleaners: decoder and driver.

The device sends 100 frames a second and takes no commands. A frame has yaw, pitch, roll and accelerations, but no
rates: the rates here are the turn between two frames, divided by the time that their index tells.

The maker's text says that pitch turns about y. In the maker's own example frame, gravity lies where pitch turns about x
and roll about y; so does this module.
"""

import struct
from dataclasses import dataclass
from math import atan2, cos, hypot, radians, sin
from typing import Annotated, Final

from annotated_types import MinLen

from txt1.config.sources import checked
from txt1.sensors.base import Setup
from txt1.sensors.readings import (
    IMU_MOUNT,
    STANDARD_GRAVITY,
    ImuReading,
    ImuSigma,
    Mount,
    Quaternion,
    Vector,
    imu_topic,
)
from txt1.sensors.stream import Framed, Measured, Streamed
from txt1.units import NotNegative, PositiveInt

HEAD: Final = b"\xaa\xaa"
# head, index, hundredths of a degree of yaw, pitch and roll, thousandths of g, three reserved bytes, checksum
FRAME: Final = struct.Struct("<2sB6h3xB")
# s between two frames
FRAME_PERIOD: Final = 0.01
# number of lost frames after which the rates are not known
GAP_MAX: Final = 10
# rad/s: the device measures 2000 degrees/s; whoever turns faster has started again
TURN_RATE_MAX: Final = 35.0


def checksum(frame: bytes) -> int:
    """Return the checksum of a frame: the sum of the bytes between head and checksum, modulo 256."""
    return sum(frame[2:-1]) & 0xFF


def pack(index: int, degrees: Vector, g: Vector) -> bytes:
    """Return a frame of yaw, pitch and roll, degrees, and accelerations, g."""
    angles, forces = (round(each * 100.0) for each in degrees), (round(each * 1000.0) for each in g)
    frame = FRAME.pack(HEAD, index & 0xFF, *angles, *forces, 0)
    return frame[:-1] + bytes((checksum(frame),))


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation b followed by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def orientation_of(yaw: float, pitch: float, roll: float) -> Quaternion:
    """Return the device's orientation: turned by yaw about z, then pitch about its x, then roll about its y; rad."""
    about_z = (0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw))
    about_x = (sin(0.5 * pitch), 0.0, 0.0, cos(0.5 * pitch))
    about_y = (0.0, sin(0.5 * roll), 0.0, cos(0.5 * roll))
    return product(product(about_z, about_x), about_y)


def rates_between(before: Quaternion, after: Quaternion, dt: float) -> Vector:
    """Return the constant rates, rad/s about the body's axes, that turn one orientation into another in dt s."""
    x, y, z, w = product((-before[0], -before[1], -before[2], before[3]), after)
    half = hypot(x, y, z)
    if w < 0.0:
        # the shorter way round
        x, y, z, w = -x, -y, -z, -w
    # angle over sine of the half angle; 2 for small turns
    scale = (2.0 * atan2(half, w) / half if half > 1e-9 else 2.0) / dt
    return x * scale, y * scale, z * scale


class RvcDecoder(Framed[ImuReading]):
    """Decodes frames into readings in the vehicle's axes; `mount.yaw` is the angle of the device's x axis to them."""

    def __init__(self, mount: Mount = IMU_MOUNT, sigma: ImuSigma | None = None) -> None:
        super().__init__()
        self._yaw, self._mount, self._sigma = mount.yaw, mount._replace(yaw=0.0), sigma
        # index and orientation of the last frame
        self._before: tuple[int, Quaternion] | None = None

    def frame(self, data: bytes, at: int, found: list[Measured[ImuReading]]) -> int | None:
        """Take the frame at an offset."""
        frame = data[at : at + FRAME.size]
        if not HEAD.startswith(frame[:2]):
            return 0
        if len(frame) < FRAME.size:
            return None
        if checksum(frame) != frame[-1]:
            return 0
        _, index, *numbers, _ = FRAME.unpack(frame)
        yaw, pitch, roll = (radians(number / 100.0) for number in numbers[:3])
        ax, ay, az = (number / 1000.0 * STANDARD_GRAVITY for number in numbers[3:])
        turned = orientation_of(yaw, pitch, roll)
        # the vehicle's axes, not the device's
        orientation = product(turned, (0.0, 0.0, -sin(0.5 * self._yaw), cos(0.5 * self._yaw)))
        c, s = cos(self._yaw), sin(self._yaw)
        before, self._before = self._before, (index, orientation)
        if before is not None and 0 < (gap := (index - before[0]) & 0xFF) <= GAP_MAX:
            rates = rates_between(before[1], orientation, gap * FRAME_PERIOD)
            if hypot(*rates) < TURN_RATE_MAX:
                force = c * ax - s * ay, s * ax + c * ay, az
                reading = ImuReading(force, rates, orientation, None, self._mount, self._sigma)
                found.append(Measured(reading, None, 0.5 * FRAME_PERIOD))
        return FRAME.size


SIGMA: Final = ImuSigma(rates=0.01, acceleration=1.0, attitude=0.02, heading=0.1)
"""Assumed; the rates are no better than a hundredth of a degree in a hundredth of a second."""


@dataclass(frozen=True, slots=True)
class RvcOptions:
    """The place of the device, and its mounting."""

    port: Annotated[str, MinLen(1)] = "/dev/serial0"
    """Serial device, or socket://host:port."""
    baud: PositiveInt = 115200
    """Bits a second, 8N1."""
    latency: NotNegative = 0.002
    """Time from measuring to the last byte, s: 19 bytes take 1.6 ms."""
    mount: Mount = IMU_MOUNT
    """x, y, z (m) on the vehicle, and the angle (rad) of the device's x axis to the vehicle's."""
    sigma: ImuSigma = SIGMA
    """Standard deviations for its messages: rates (rad/s), accelerations (m/s^2), roll and pitch, heading (rad)."""


def create(setup: Setup) -> Streamed[ImuReading]:
    """Make the driver ``imu_bno08x_rvc``; options: those of `RvcOptions`."""
    given = checked(RvcOptions, setup.options, f"sensors.{setup.name}.options")
    return Streamed(
        imu_topic(setup.name),
        FRAME_PERIOD,
        given.port,
        lambda: RvcDecoder(given.mount, given.sigma),
        given.baud,
        given.latency,
        "txt1 sensor virtual bno08x",
    )
