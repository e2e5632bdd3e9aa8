"""MicroStrain 3DM-GX2 and 3DM-GX3: the decoder, and the driver.

The device has x forward, y right and z down.
"""

import struct
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Annotated, Final, Literal

from annotated_types import MinLen

from txt1.config.sources import checked
from txt1.sensors.base import Setup
from txt1.sensors.readings import IMU_MOUNT, STANDARD_GRAVITY, ImuReading, ImuSigma, Mount, Quaternion, imu_topic
from txt1.sensors.stream import Framed, Measured, Streamed, Unwrapped
from txt1.units import NotNegative, PositiveInt

# accelerations, rates, orientation matrix
PLAIN: Final = 0xC8
# accelerations, rates, magnetic field, orientation matrix
MAGNETIC: Final = 0xCC
# followed by the command that is repeated from then on
CONTINUOUS: Final = b"\xc4\xc1\x29"
# reply to the command before: 8 bytes
CONFIRMED: Final = 0xC4
# reply to a request for a name: 20 bytes
IDENTIFIER: Final = 0xEA
STOP: Final = {"gx2": b"\xfa", "gx3": b"\xfa\x75\xb4"}
# ticks of the timer a second
TICKS: Final = {"gx2": 19_660_800.0, "gx3": 62_500.0}
LENGTHS: Final = {PLAIN: 67, MAGNETIC: 79, CONFIRMED: 8, IDENTIFIER: 20}
GAUSS: Final = 1e-4  # T
# larger accelerations in g and rates in rad/s are no measurements
MEASUREMENT_MAX: Final = 100.0

# 3 x 3, row by row
Matrix = tuple[float, ...]
Model = Literal["gx2", "gx3"]


def checksum(data: bytes) -> int:
    """Return the sum of the bytes, modulo 65536."""
    return sum(data) & 0xFFFF


def pack(command: int, numbers: tuple[float, ...], ticks: int) -> bytes:
    """Return a reply of the device: big-endian float32, the timer, the checksum."""
    data = struct.pack(f">B{len(numbers)}fI", command, *numbers, ticks & 0xFFFFFFFF)
    return data + struct.pack(">H", checksum(data))


def orientation_of(m: Matrix) -> Quaternion:
    """Return the orientation of a body with x forward and z up, north-west-up, from the device's matrix
    (north-east-down).

    The device's matrix M turns a vector of the earth's frame into the device's frame. With D = diag(1, -1, -1) for the
    flipped axes, D M^T D turns a vector of the vehicle's frame into the earth's.
    """
    r00, r10, r20 = m[0], -m[1], -m[2]
    r01, r11, r21 = -m[3], m[4], m[5]
    r02, r12, r22 = -m[6], m[7], m[8]
    squares = (r00 - r11 - r22, r11 - r00 - r22, r22 - r00 - r11, r00 + r11 + r22)
    largest = max(range(4), key=squares.__getitem__)
    s = sqrt(max(squares[largest] + 1.0, 1e-12)) * 2.0
    match largest:
        case 0:
            return 0.25 * s, (r01 + r10) / s, (r02 + r20) / s, (r21 - r12) / s
        case 1:
            return (r01 + r10) / s, 0.25 * s, (r12 + r21) / s, (r02 - r20) / s
        case 2:
            return (r02 + r20) / s, (r12 + r21) / s, 0.25 * s, (r10 - r01) / s
    return (r21 - r12) / s, (r02 - r20) / s, (r10 - r01) / s, 0.25 * s


def matrix_of(orientation: Quaternion) -> Matrix:
    """Return the device's matrix for an orientation: the inverse of `orientation_of`."""
    x, y, z, w = orientation
    r = (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
    return r[0], -r[3], -r[6], -r[1], r[4], r[7], -r[2], r[5], r[8]


class ImuDecoder(Framed[ImuReading]):
    """Decodes the device's bytes into readings. After a damaged reply it goes on at the next intact reply."""

    def __init__(
        self, model: Model = "gx2", magnetic: bool = False, mount: Mount = IMU_MOUNT, sigma: ImuSigma | None = None
    ) -> None:
        super().__init__(STOP[model] + CONTINUOUS + bytes((MAGNETIC if magnetic else PLAIN,)), STOP[model])
        self.identifier = ""
        """The device's name; empty until it is known."""
        self._mount, self._sigma = mount, sigma
        self._timer, self._ticks = Unwrapped(2.0**32), TICKS[model]

    def frame(self, data: bytes, at: int, found: list[Measured[ImuReading]]) -> int | None:
        """Take the reply at an offset."""
        length = LENGTHS.get(data[at], 0)
        if len(data) - at < length:
            return None
        frame = data[at : at + length]
        sound = length and checksum(frame[:-2]) == int.from_bytes(frame[-2:]) and self._take(frame, found)
        return length if sound else 0

    def _take(self, frame: bytes, found: list[Measured[ImuReading]]) -> bool:
        """Return whether a frame with the right checksum is plausible; append its reading, if it has one."""
        if frame[0] == CONFIRMED:
            return True
        if frame[0] == IDENTIFIER:
            self.identifier = frame[2:-2].decode("ascii", "replace").strip(" \0")
            return True
        *numbers, ticks = struct.unpack(f">{(len(frame) - 7) // 4}fI", frame[1:-2])
        if not all(map(isfinite, numbers)) or max(map(abs, numbers[:6])) > MEASUREMENT_MAX:
            return False
        ax, ay, az, p, q, r, *rest = numbers
        magnetic = None
        if frame[0] == MAGNETIC:
            bx, by, bz, *rest = rest
            magnetic = (bx * GAUSS, -by * GAUSS, -bz * GAUSS)
        # + 0.0 turns -0.0 into 0.0
        reading = ImuReading(
            (ax * STANDARD_GRAVITY, -ay * STANDARD_GRAVITY + 0.0, -az * STANDARD_GRAVITY + 0.0),
            (p, -q + 0.0, -r + 0.0),
            orientation_of(tuple(rest)),
            magnetic,
            self._mount,
            self._sigma,
        )
        found.append(Measured(reading, self._timer(ticks) / self._ticks))
        return True


SIGMA: Final = ImuSigma(rates=0.006, acceleration=1.0, attitude=0.005, heading=0.035)
"""Assumed equal to the errors of the simulated IMU, on a car at 1 m/s."""


@dataclass(frozen=True, slots=True)
class ImuOptions:
    """The place of the device, and its mounting."""

    port: Annotated[str, MinLen(1)] = "/dev/ttyUSB0"
    """Serial device, or socket://host:port."""
    baud: PositiveInt = 115200
    """Bits a second, 8N1."""
    model: Model = "gx2"
    """gx2, or gx3: its timer is slower, its stop command longer."""
    magnetic: bool = False
    """Whether the magnetic field is requested, too."""
    latency: NotNegative = 0.006
    """Time from measuring to the last byte, s: 67 bytes take 5.8 ms at 115200 baud."""
    mount: Mount = IMU_MOUNT
    """x, y, z (m) and yaw (rad) on the vehicle."""
    sigma: ImuSigma = SIGMA
    """Standard deviations for its messages: rates (rad/s), accelerations (m/s^2), roll and pitch, heading (rad)."""


def create(setup: Setup) -> Streamed[ImuReading]:
    """Make the driver ``imu_3dmgx2``; options: those of `ImuOptions`."""
    given = checked(ImuOptions, setup.options, f"sensors.{setup.name}.options")
    return Streamed(
        imu_topic(setup.name),
        0.01,
        given.port,
        lambda: ImuDecoder(given.model, given.magnetic, given.mount, given.sigma),
        given.baud,
        given.latency,
        "txt1 sensor virtual imu",
    )
