"""LDROBOT LD06 and LD19, low-cost laser scanners that send unasked: the decoder, and the driver."""

import struct
from dataclasses import dataclass
from math import inf, isnan, nan, tau
from typing import Annotated, Final

import numpy as np
from annotated_types import MinLen

from txt1.config.sources import checked
from txt1.sensors.base import Setup
from txt1.sensors.readings import LASER_MOUNT, Mount, Scan, scan_topic
from txt1.sensors.stream import Framed, Measured, Streamed, Unwrapped
from txt1.units import NotNegative, PositiveInt

# points of a packet
POINTS: Final = 12
# head, kind, speed, angle, points, angle, time, check
PACKET: Final = struct.Struct("<BBHH" + "HB" * POINTS + "HHB")
HEAD: Final = b"\x54\x2c"
# milliseconds at which the time stamp starts again at 0
CLOCK_WRAP: Final = 30000.0
# points of a turn: 4500 points a second at 10 turns a second
BEAMS: Final = 450
# table of the checksum, a CRC of eight bits
POLYNOMIAL: Final = 0x4D
RANGE_MIN: Final = 0.02  # m
RANGE_MAX: Final = 12.0  # m
# degrees a second, the fastest turn
TURN_SPEED_MAX: Final = 7200


def _table() -> tuple[int, ...]:
    found = []
    for value in range(256):
        for _ in range(8):
            value = (value << 1 ^ POLYNOMIAL if value & 0x80 else value << 1) & 0xFF
        found.append(value)
    return tuple(found)


_CRC: Final = _table()


def crc(data: bytes) -> int:
    """Return the checksum of a packet without its last byte."""
    value = 0
    for byte in data:
        value = _CRC[value ^ byte]
    return value


def pack(speed: float, start: float, end: float, points: list[tuple[int, int]], ms: int) -> bytes:
    """Return a packet: degrees a second; degrees clockwise of the first and last point; (mm, intensity) of
    each; time.
    """
    numbers = [number for point in points for number in point]
    head = round(speed), round(start * 100.0) % 36000
    data = PACKET.pack(*HEAD, *head, *numbers, round(end * 100.0) % 36000, ms % 30000, 0)[:-1]
    return data + bytes((crc(data),))


class Ld19Decoder(Framed[Scan]):
    """Decodes packets into scans: a turn each, clockwise from straight ahead, in beams of 0.8 degrees.

    A beam without a sample is not known (NaN), as those of lost packets.
    """

    def __init__(self, mount: Mount = LASER_MOUNT) -> None:
        super().__init__()
        self._mount = mount
        self._clock = Unwrapped(CLOCK_WRAP)
        # None until a turn begins
        self._ranges: np.ndarray[tuple[int], np.dtype[np.float32]] | None = None
        self._intensities = np.zeros(BEAMS, np.float32)
        # angle of the last point, degrees
        self._before = 0.0
        # start of the turn, s by the device's clock
        self._began = 0.0

    def frame(self, data: bytes, at: int, found: list[Measured[Scan]]) -> int | None:
        """Take the packet at an offset."""
        packet = data[at : at + PACKET.size]
        if not HEAD.startswith(packet[:2]):
            return 0
        if len(packet) < PACKET.size:
            return None
        if crc(packet[:-1]) != packet[-1]:
            return 0
        self._take(packet, found)
        return PACKET.size

    def _take(self, packet: bytes, found: list[Measured[Scan]]) -> None:
        """Add the points of a packet to the turn.

        A point that does not lie beyond the last point begins the next turn.
        """
        _, _, speed, start, *numbers, end, ms, _ = PACKET.unpack(packet)
        if not 0 < speed <= TURN_SPEED_MAX or start >= 36000 or end >= 36000:
            self.faults += 1
            return
        width = ((end - start) % 36000) / 100.0
        # angle of the last point
        time = self._clock(ms) / 1000.0
        for k in range(POINTS):
            angle = (start / 100.0 + width * k / (POINTS - 1)) % 360.0
            if angle < self._before - 180.0:
                when = time - width * (1.0 - k / (POINTS - 1)) / speed
                self._turn(when, speed, found)
                self._began = when
            self._before = angle
            if self._ranges is not None:
                mm, intensity = numbers[2 * k], numbers[2 * k + 1]
                near, beam = mm / 1000.0 if mm else inf, round(angle / 360.0 * BEAMS) % BEAMS
                # what is too near to be measured tells nothing
                if near >= RANGE_MIN and (isnan(self._ranges[beam]) or near < self._ranges[beam]):
                    self._ranges[beam], self._intensities[beam] = near, intensity

    def _turn(self, time: float, speed: float, found: list[Measured[Scan]]) -> None:
        """End the turn at this time, and begin the next."""
        ranges, intensities = self._ranges, self._intensities
        self._ranges, self._intensities = np.full(BEAMS, nan, np.float32), np.zeros(BEAMS, np.float32)
        if ranges is None or not 0.0 < time - self._began < 2.0 * 360.0 / speed:
            return
        ranges[ranges > RANGE_MAX] = inf
        step = -tau / BEAMS
        turn = 360.0 / speed
        scan = Scan(0.0, step, turn / BEAMS, ranges, RANGE_MIN, RANGE_MAX, intensities, self._mount, turn)
        found.append(Measured(scan, time, time - self._began))


@dataclass(frozen=True, slots=True)
class Ld19Options:
    """The place of the scanner, and its mounting."""

    port: Annotated[str, MinLen(1)] = "/dev/ttyUSB0"
    """Serial device, or socket://host:port."""
    baud: PositiveInt = 230400
    """Bits a second, 8N1."""
    latency: NotNegative = 0.0
    """Time from measuring to sending, s; the duration of a turn is known from its stamps."""
    mount: Mount = LASER_MOUNT
    """x, y, z (m) and yaw (rad) on the vehicle."""


def create(setup: Setup) -> Streamed[Scan]:
    """Make the driver ``laser_ld19``; options: those of `Ld19Options`."""
    given = checked(Ld19Options, setup.options, f"sensors.{setup.name}.options")
    return Streamed(
        scan_topic(setup.name), 0.1, given.port, lambda: Ld19Decoder(given.mount), given.baud, given.latency
    )
