"""YDLIDAR laser scanners (X2, X4, TG15, TG30, TG50): the decoder, and the driver.

How it works
------------

An X2 sends as soon as it has power, and takes no commands. The others are stopped, and then told to scan. The line DTR
is up while the port is open, by which the vendor's adapter lets the motor turn.

A packet has up to 255 samples, the angles of the first and of the last of them, and a checksum. Angles grow clockwise,
as seen from above, and the samples between lie at equal angles. A packet of a single sample begins a turn, and may tell
the rate of turns. An X2 and an X4 triangulate: laser and camera sit beside each other, so the nearer a thing is, the
earlier or later it is seen, and each angle is corrected by the sample's distance (the vendor's formula). A TG measures
the time of flight.

The scanner sends no times. So the time of a turn is that of its arrival, and its length follows from the rate of turns
that it tells, or from the number of its samples.
"""

import struct
from dataclasses import dataclass
from functools import reduce
from math import inf
from operator import xor
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, MinLen

from txt1.config.sources import checked
from txt1.sensors.base import Setup
from txt1.sensors.laser_turns import Numbers, beams_for, scan_of_turn
from txt1.sensors.readings import LASER_MOUNT, Mount, Scan, scan_topic
from txt1.sensors.stream import Framed, Measured, Streamed
from txt1.units import NotNegative

Model = Literal["x2", "x4", "tg15", "tg30", "tg50"]

# commands
SCAN_COMMAND: Final = b"\xa5\x60"
STOP_COMMAND: Final = b"\xa5\x65"
# what announces packets
SCAN_ANSWER: Final = b"\xa5\x5a\x05\x00\x00\x40\x81"
PACKET_HEAD: Final = b"\xaa\x55"
# head, type, number of samples, angles of the first and the last, checksum
FIXED: Final = struct.Struct("<2sBBHHH")
# of a packet's type: it begins a turn
RING: Final = 1
# s between the two commands
COMMAND_PAUSE: Final = 0.1
# s without a turn after which it is greeted again: the motor takes its time
TURN_PATIENCE: Final = 5.0
# degrees that a whole turn is swept, at least and at most
SWEPT: Final = (270.0, 450.0)
# of the triangulation: mm between laser and camera, and of its zero
BASE_LINE: Final = 21.8
ZERO: Final = 155.3


class YdlidarModel(NamedTuple):
    """What a model is like."""

    baud: int
    """Bits a second, 8N1."""
    commands: bool
    triangulates: bool
    rate: float
    """Samples a second."""
    range_min: float
    """m."""
    range_max: float
    """m."""


MODELS: Final[dict[Model, YdlidarModel]] = {
    "x2": YdlidarModel(115200, False, True, 3000.0, 0.12, 8.0),
    "x4": YdlidarModel(128000, True, True, 5000.0, 0.12, 10.0),
    "tg15": YdlidarModel(512000, True, False, 20000.0, 0.05, 15.0),
    "tg30": YdlidarModel(512000, True, False, 20000.0, 0.05, 30.0),
    "tg50": YdlidarModel(512000, True, False, 20000.0, 0.05, 50.0),
}


def corrections(mm: Numbers) -> Numbers:
    """Return the degrees by which samples at these distances lie clockwise of their turn of the head; 0 for no hit."""
    there = np.maximum(mm, 1.0)
    return np.where(mm > 0.0, np.degrees(np.arctan(BASE_LINE * (ZERO - there) / (ZERO * there))), 0.0)


def packet(kind: int, first: float, last: float, samples: Numbers) -> bytes:
    """Return a packet: its type, degrees of its first and last sample, and the samples as they are sent."""
    angles = [round(angle * 64.0) % 23040 << 1 | 1 for angle in (first, last)]
    data = np.asarray(samples).astype("<u2")
    check = reduce(xor, (*data.tolist(), *angles, int.from_bytes(PACKET_HEAD, "little"), kind | len(data) << 8))
    return FIXED.pack(PACKET_HEAD, kind, len(data), *angles, check) + data.tobytes()


class YdlidarDecoder(Framed[Scan]):
    """Decodes packets into turns, clockwise from straight ahead."""

    def __init__(self, model: YdlidarModel, mount: Mount = LASER_MOUNT) -> None:
        super().__init__(STOP_COMMAND if model.commands else b"", STOP_COMMAND if model.commands else b"")
        self._model, self._mount = model, mount
        self.pause = COMMAND_PAUSE if model.commands else None
        # samples of this turn, degrees and mm; None until a turn begins
        self._samples: list[tuple[Numbers, Numbers]] | None = None
        # degrees that this turn was swept, and the last sample's
        self._swept = self._last = 0.0
        # of beams, once a turn is known
        self._beams = 0

    def resume(self) -> None:
        """Start the scan."""
        self._out, self.pause = SCAN_COMMAND, inf

    def frame(self, data: bytes, at: int, found: list[Measured[Scan]]) -> int | None:
        """Take the packet at an offset."""
        head = data[at : at + FIXED.size]
        if SCAN_ANSWER.startswith(head[: len(SCAN_ANSWER)]):
            return len(SCAN_ANSWER) if len(head) >= len(SCAN_ANSWER) else None
        if not PACKET_HEAD.startswith(head[:2]):
            return 0
        if len(head) < FIXED.size:
            return None
        _, kind, count, first, last, _ = FIXED.unpack(head)
        if not count:
            return 0
        length: int = FIXED.size + 2 * count
        if len(data) < at + length:
            return None
        words = np.frombuffer(data, "<u2", length // 2, at)
        # the checksum is among the words
        if int(np.bitwise_xor.reduce(words)) != 0:
            return 0
        self._take(kind, (first >> 1) / 64.0, (last >> 1) / 64.0, words[FIXED.size // 2 :].astype(float), found)
        return length

    def _take(self, kind: int, first: float, last: float, raw: Numbers, found: list[Measured[Scan]]) -> None:
        mm = raw / 4.0 if self._model.triangulates else raw
        angles = first + (last - first) % 360.0 * np.arange(len(mm)) / max(len(mm) - 1, 1)
        if self._model.triangulates:
            angles = angles + corrections(mm)
        self._swept += (last - self._last) % 360.0
        self._last = last
        if kind & RING:
            self._turn((kind >> 1) / 10.0, found)
        if self._samples is not None:
            self._samples.append((angles, mm))

    def _turn(self, frequency: float, found: list[Measured[Scan]]) -> None:
        """End this turn, and begin the next; `frequency`: turns a second, 0 if it does not tell."""
        samples, swept = self._samples, self._swept
        self._samples, self._swept = [], 0.0
        if not samples:
            return
        if not SWEPT[0] < swept < SWEPT[1]:
            # the packet that began another turn was lost
            self.faults += 1
            return
        angles, mm = (np.concatenate(each) for each in zip(*samples, strict=True))
        self._beams = self._beams or beams_for(len(mm))
        turn = 1.0 / frequency if frequency else len(mm) / self._model.rate
        reach = self._model.range_min, self._model.range_max
        found.append(Measured(scan_of_turn(angles, mm, self._beams, turn, *reach, self._mount), None, turn))


@dataclass(frozen=True, slots=True)
class YdlidarOptions:
    """The scanner, its place, and its mounting."""

    model: Model
    """Its model."""
    port: Annotated[str, MinLen(1)] = "/dev/ttyUSB0"
    """Serial device, or socket://host:port."""
    baud: Annotated[int, Ge(0)] = 0
    """Bits a second, 8N1; 0: the model's."""
    latency: NotNegative = 0.0
    """Time from measuring to sending, s."""
    mount: Mount = LASER_MOUNT
    """x, y, z (m) and yaw (rad) on the vehicle."""


def create(setup: Setup) -> Streamed[Scan]:
    """Make the driver ``laser_ydlidar``; options: those of `YdlidarOptions`."""
    given = checked(YdlidarOptions, setup.options, f"sensors.{setup.name}.options")
    model = MODELS[given.model]
    return Streamed(
        scan_topic(setup.name),
        0.1,
        given.port,
        lambda: YdlidarDecoder(model, given.mount),
        given.baud or model.baud,
        given.latency,
        "txt1 sensor virtual ydlidar",
        TURN_PATIENCE,
    )
